"""The pictures of a map: what a person sees where, and that the legend says the same."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from map_factory import CONFIDENCE, METRES, SPACING_PX, make_map, make_site, metric_report
from report_factory import make_ambiguity, make_image, make_report

from slopecli.ground import SlopeMap
from slopecli.products import draw_map, draw_sigma
from slopecli.products.drawing import (
    LONG_SIDE_PX,
    STEP,
    UNKNOWN,
    bar_length_m,
    cell_area_m2,
    cell_classes,
    lightness_of,
    map_frame,
    north_px,
    share_text,
    sigma_classes,
    slope_classes,
    spread,
)
from slopecli.types import Diagnostic, Image, Up

ROWS, COLUMNS = 100, 150  # of a map of 1200 x 800 px, which is drawn at its size
CLASS_SLOPES = (2.0, 7.0, 12.0, 17.0, 25.0, 40.0)  # one in every default class


def flat_image(width: int = COLUMNS * SPACING_PX, height: int = ROWS * SPACING_PX) -> Image:
    return Image(np.full((height, width), 128, np.uint8))


def striped(slopes: tuple[float, ...] = CLASS_SLOPES, sigma_deg: float = 0.1, **changes: object) -> SlopeMap:
    """Vertical stripes of equal width, one for each slope."""
    return make_map(np.repeat(slopes, COLUMNS // len(slopes))[None].repeat(ROWS, axis=0), sigma_deg, **changes)


def stripe(k: int, count: int = len(CLASS_SLOPES)) -> tuple[slice, slice]:
    """Pixels well inside a stripe."""
    width = COLUMNS * SPACING_PX // count
    return slice(100, 700), slice(k * width + 30, (k + 1) * width - 30)


def drawn(slope_map: SlopeMap, image: Image | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Picture and legend, (h, w, 3) RGB each, of a map without warnings."""
    image = image or flat_image()
    sheet = draw_map(slope_map, image)[:, :, ::-1]
    height = map_frame(image).height
    return sheet[:height], sheet[height:]


def grey_of(picture: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(np.ascontiguousarray(picture), cv2.COLOR_RGB2GRAY).astype(int)


def has_colour(picture: np.ndarray, colour: np.ndarray) -> int:
    return int((picture == colour).all(axis=2).sum())


# ---- classes ----


def test_tolerance_is_an_edge_of_classes_and_belongs_to_the_gentle_side() -> None:
    classes = slope_classes(striped(classes_deg=(10.0, 20.0), tolerance_deg=12.0))
    assert classes.edges_deg == (10.0, 12.0, 20.0)
    assert classes.names == ["0-10°", "10-12°", "12-20°", "over 20°"]
    assert classes.steep_from == 2
    assert classes.of([0.0, 10.0, 11.0, 12.0, 12.01, 90.0, np.nan]).tolist() == [0, 0, 1, 1, 2, 3, UNKNOWN]


@pytest.mark.parametrize("edges", [(5.0, 10.0, 15.0, 20.0, 30.0), (1.0, 2.0, 3.0), (20.0, 40.0), tuple(range(1, 12))])
def test_classes_differ_in_lightness_alone(edges: tuple[float, ...]) -> None:
    for classes in (slope_classes(striped(classes_deg=edges)), sigma_classes()):
        steps = np.diff(lightness_of(classes.colours))
        assert len(classes.colours) == len(classes.edges_deg) + 1
        assert steps.min() > 60 / len(classes.colours) - 3.5


def without_green_cones(colours: np.ndarray) -> np.ndarray:
    """RGB as seen with deuteranopia. Source: Vienot, Brettel, Mollon, 1999, on linear light."""
    linear = (np.asarray(colours) / 255.0) ** 2.2
    matrix = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]])
    return 255.0 * np.clip(linear @ matrix.T, 0.0, 1.0) ** (1 / 2.2)


def test_the_sides_of_the_tolerance_differ_in_hue_without_red_green_vision() -> None:
    classes = slope_classes(striped())
    seen = without_green_cones(classes.colours)
    blue = seen[:, 2] - seen[:, :2].mean(axis=1)
    assert (blue[: classes.steep_from] > 25).all()
    assert (blue[classes.steep_from :] < -25).all()
    assert (np.diff(lightness_of(seen)) > 8).all()


# ---- colours of the picture ----


def test_cells_have_the_colour_of_their_swatch_in_the_legend() -> None:
    slope_map = striped()
    picture, legend = drawn(slope_map)
    for k, colour in enumerate(slope_classes(slope_map).colours):
        assert (picture[stripe(k)] == colour).all()
        assert has_colour(legend, colour) > 300


def test_the_image_only_modulates_the_colour_of_a_class() -> None:
    picture, _ = drawn(striped(), make_image(1200, 800))
    for k, colour in enumerate(slope_classes(striped()).colours):
        shown = picture[stripe(k)].reshape(-1, 3).astype(float)
        assert np.abs(shown.mean(axis=0) - colour).max() < 6
        assert shown.std(axis=0).min() > 2


def test_cells_stand_where_they_were_measured() -> None:
    """Cell (i, j) covers pixels 8 j to 8 j + 7, of the image as of a picture of another scale."""
    slope = np.full((ROWS, COLUMNS), 2.0)
    slope[40:50, 60:90] = 7.0
    picture, _ = drawn(make_map(slope, 0.1))
    rows, columns = np.nonzero((picture == slope_classes(make_map(slope)).colours[1]).all(axis=2))
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (320, 399, 480, 719)
    cells = np.arange(6, dtype=np.int16).reshape(2, 3)
    upper, lower = [0, 0, 1, 1, 1, 2, 2, -1], [3, 3, 4, 4, 4, 5, 5, -1]
    assert spread(cells, (5, 8), 2.5, -1).tolist() == [upper] * 2 + [lower] * 3
    assert spread(cells, (6, 8), 2.5, -1)[5].tolist() == [-1] * 8


@pytest.mark.parametrize(("width", "height"), [(640, 480), (300, 900), (64, 64), (3000, 2000)])
def test_any_size_is_drawn_legibly(width: int, height: int) -> None:
    slope = np.random.default_rng(3).uniform(0, 40, (height // SPACING_PX, width // SPACING_PX))
    slope_map = make_map(slope, report=metric_report(width, height), sites=(make_site(1, (30.0, 30.0), 20.0),))
    for draw in (draw_map, draw_sigma):
        sheet = draw(slope_map, flat_image(width, height))
        assert sheet.dtype == np.uint8
        long_side = np.clip(max(width, height), LONG_SIDE_PX["smallest map"], LONG_SIDE_PX["largest"])
        assert sheet.shape[1] == round(width * long_side / max(width, height))
        assert sheet.shape[0] > round(height * long_side / max(width, height))


# ---- the edge at the tolerance ----


def dark_or_white(picture: np.ndarray) -> np.ndarray:
    """Where the line of the edge shows: darker, or lighter, than every class here."""
    grey = grey_of(picture)
    return (grey < 30) | (grey > 245)


def test_the_edge_lies_between_the_sides_of_the_tolerance_only() -> None:
    picture, _ = drawn(striped())
    columns = np.flatnonzero(dark_or_white(picture)[100:700].mean(axis=0) > 0.9)
    assert len(columns) >= 3
    assert np.abs(columns - 599.5).max() < 5  # between the third stripe and the fourth
    band = grey_of(picture)[400, 590:610]
    assert band.max() - band.min() > 180  # dark and white side by side show on any ground


def test_the_border_of_the_unknown_has_no_edge() -> None:
    slope = np.full((ROWS, COLUMNS), 2.0)
    slope[:, 50:100] = np.nan
    slope[:, 100:] = 40.0
    step = np.zeros(slope.shape, bool)
    for slope_map in (make_map(slope, 0.1), make_map(np.where(np.isnan(slope), 2.0, slope), 0.1, step=step)):
        picture, _ = drawn(slope_map)
        lines = dark_or_white(picture)[100:700].mean(axis=0) > 0.9
        assert lines[795:806].any() == slope_map.known.all()
        assert not lines[:780].any()


def test_one_cell_of_another_side_has_its_colour() -> None:
    slope = np.full((ROWS, COLUMNS), 2.0)
    slope[50, 70] = 40.0
    picture, _ = drawn(make_map(slope, 0.1))
    assert (picture[404, 564] == slope_classes(make_map(slope)).colours[-1]).all()


# ---- marks ----


def test_unknown_ground_is_grey_and_hatched() -> None:
    slope = np.full((ROWS, COLUMNS), 2.0)
    slope[:, :50] = np.nan
    slope_map = make_map(slope, 0.1)
    unknown = []
    for sheet in (draw_map(slope_map, flat_image()), draw_sigma(slope_map, flat_image())):
        inside = sheet[100:700, 20:380].astype(int)
        assert np.ptp(inside, axis=2).max() < 8  # no colour
        assert inside.mean(axis=2).std() > 20
        assert sheet[100:700, 430:].std(axis=(0, 1)).max() == 0
        unknown.append(inside)
    assert np.array_equal(*unknown)


@pytest.mark.parametrize("kind", ["undecided", "rough", "step"])
def test_marked_cells_differ_from_others_of_their_class_without_colour(kind: str) -> None:
    where = np.zeros((ROWS, COLUMNS), bool)
    where[:, 75:] = True
    chance = np.where(where, {"undecided": 0.6, "rough": 0.0, "step": 0.0}[kind], 1.0)
    for slope_deg in (2.0, 13.0):
        level = np.full(where.shape, slope_deg)
        picture, legend = drawn(make_map(level, 0.1, p_safe=chance, step=where & (kind == "step")))
        plain, other_legend = drawn(make_map(level, 0.1))
        assert np.array_equal(picture[:, :600], plain[:, :600])
        assert grey_of(picture)[100:700, 640:].std() > 20
        assert not np.array_equal(legend, other_legend[: len(legend)])


@pytest.mark.parametrize("p_safe", [0.6, 0.0])
def test_every_marked_cell_has_a_mark(p_safe: float) -> None:
    level = np.full((ROWS, COLUMNS), 13.0)
    chance, alone = np.ones(level.shape), [(i, 5 + i) for i in range(3, 90, 7)]
    for cell in alone:
        chance[cell] = p_safe
    picture, _ = drawn(make_map(level, p_safe=chance))
    for i, j in alone:
        cell = grey_of(picture[8 * i : 8 * i + 8, 8 * j : 8 * j + 8])
        assert cell.max() > 230
        assert cell.min() < 60


def test_the_kinds_of_marks_differ_from_each_other() -> None:
    level, all_cells = np.full((ROWS, COLUMNS), 13.0), np.full((ROWS, COLUMNS), True)
    maps = (
        make_map(level, p_safe=level * 0 + 0.6),
        make_map(level, p_safe=level * 0),
        make_map(level, step=all_cells),
        make_map(level * np.nan),
    )
    looks = [drawn(one)[0][100:400, 100:400].astype(float) for one in maps]
    for i, look in enumerate(looks):
        assert all(np.abs(look - other).mean() > 15 for other in looks[:i])


def test_steps_and_the_unknown_come_before_classes() -> None:
    slope = np.array([[2.0, np.nan, 40.0, np.nan]])
    slope_map = make_map(slope, step=np.array([[True, True, False, False]]), report=metric_report(640, 480))
    assert cell_classes(slope_map, slope_classes(slope_map)).tolist() == [[STEP, STEP, 5, UNKNOWN]]


def test_steep_ground_that_is_surely_unsafe_has_no_mark() -> None:
    picture, _ = drawn(striped((40.0, 40.0)))
    assert picture[100:700].std(axis=(0, 1)).max() == 0


# ---- sites ----


def test_sites_are_circles_at_their_places() -> None:
    site = make_site(1, (500.0, 300.0), 120.0)
    level = np.full((ROWS, COLUMNS), 2.0)
    with_site, _ = drawn(make_map(level, 0.1, sites=(site,)))
    without, _ = drawn(make_map(level, 0.1))
    changed = (with_site != without).any(axis=2)
    v, u = np.nonzero(changed)
    away = np.hypot(u - 500.0, v - 300.0)
    number = np.hypot(u - 500.0 - 85, v - 300.0 + 85) < 25
    assert (np.abs(away[~number & (away > 12)] - 120) < 6).all()
    assert changed[300, 500]
    ring = with_site[300, 610:632].astype(int)
    assert ring.max() == 250
    assert ring.min() < 30


def test_sites_show_on_every_class_and_mark() -> None:
    for slope_map in (striped(), make_map(np.full((ROWS, COLUMNS), np.nan)), striped(p_safe=np.full((100, 150), 0.5))):
        picture, _ = drawn(replace(slope_map, sites=(make_site(1, (600.0, 400.0), 300.0),)))
        turns = np.radians(np.arange(0, 360, 5))
        for turn in turns[(turns < 5.2) | (turns > 5.8)]:  # clear of the number
            u, v = 600 + 300 * np.cos(turn), 400 + 300 * np.sin(turn)
            around = grey_of(picture[round(v) - 6 : round(v) + 7, round(u) - 6 : round(u) + 7])
            assert around.max() > 240
            assert around.min() < 60


def test_a_site_that_may_be_unsafe_is_dashed() -> None:
    level = np.full((ROWS, COLUMNS), 2.0)
    site = make_site(1, (600.0, 400.0), 200.0, verdict="undecided")
    turns = np.radians(np.arange(10, 260, 0.5))
    ring = np.rint([400 + 200 * np.sin(turns), 600 + 200 * np.cos(turns)]).astype(int)
    shades = {}
    for verdict in ("safe", "undecided"):
        picture, _ = drawn(make_map(level, 0.1, sites=(replace(site, verdict=verdict),)))
        shades[verdict] = grey_of(picture)[ring[0], ring[1]]
    assert shades["safe"].min() > 240
    assert np.ptp(shades["undecided"]) > 120


def test_numbers_of_sites_at_the_border_stay_on_the_picture() -> None:
    corners = [(0.0, 0.0), (1199.0, 0.0), (0.0, 799.0), (1199.0, 799.0)]
    sites = tuple(make_site(k + 1, corner, 60.0) for k, corner in enumerate(corners))
    picture, _ = drawn(make_map(np.full((ROWS, COLUMNS), 2.0), 0.1, sites=sites))
    for u, v in ((42, 17), (1182, 17), (42, 757), (1182, 757)):
        spot = picture[max(v - 17, 0) : v + 17, u - 17 : u + 17]
        assert (spot == 250).all(axis=2).mean() > 0.3


# ---- legend ----


def test_shares_say_how_much_of_the_picture_and_of_the_ground() -> None:
    slope = np.full((60, 80), 2.0)
    slope[:, :8] = np.nan
    slope_map = make_map(slope, report=metric_report(640, 480))
    area = cell_area_m2(slope_map)
    np.testing.assert_allclose(area[:, 9:], (SPACING_PX * METRES) ** 2, rtol=1e-6)
    assert share_text(slope_map.known, area) == "90.0 %, 691 sq m"
    assert share_text(np.zeros((3, 3), bool)) == "0 %"
    assert share_text(np.arange(5000) == 1) == "<0.1 %"
    assert cell_area_m2(replace(slope_map, report=make_report())) is None


def test_ground_seen_at_an_angle_has_its_own_area() -> None:
    slope_map = make_map(np.full((60, 80), 2.0), report=metric_report(640, 480))
    points = slope_map.points.copy()
    points[..., 2] += points[..., 0]  # a slope of 45 degrees against the camera's axis
    tilted = cell_area_m2(replace(slope_map, points=points))
    np.testing.assert_allclose(tilted, np.sqrt(2) * (SPACING_PX * METRES) ** 2, rtol=1e-6)


def test_scale_bar_is_a_round_length_of_its_size() -> None:
    slope_map = make_map(np.full((60, 80), 2.0), report=metric_report(640, 480))
    for longest_px in (30, 100, 250, 999):
        metres, length_px = bar_length_m(slope_map, 2.0, longest_px)
        assert longest_px / 2.6 < length_px <= longest_px
        assert length_px == pytest.approx(metres / METRES * 2.0)
        assert f"{metres:.0e}"[0] in "125"
    assert bar_length_m(replace(slope_map, report=make_report()), 1.0, 250) is None


def test_north_points_where_it_is_in_the_image() -> None:
    slope_map = make_map(np.full((60, 80), 2.0), report=metric_report(640, 480))
    assert north_px(slope_map).tolist() == [0.0, -1.0]
    np.testing.assert_allclose(north_px(replace(slope_map, north_cam1=(1.0, 0.0, 0.7))), [1.0, 0.0], atol=1e-9)
    assert north_px(replace(slope_map, north_cam1=(0.0, 0.0, 1.0))) is None
    level_view = metric_report(640, 480, up=Up((0.0, -1.0, 0.0), "given"))
    assert north_px(replace(slope_map, north_cam1=(0.0, 0.0, 1.0), report=level_view)) is None
    np.testing.assert_allclose(
        north_px(replace(slope_map, north_cam1=(1.0, 0.0, 1.0), report=level_view)), [1.0, 0.0], atol=1e-9
    )


def test_warnings_stand_above_the_map() -> None:
    slope_map = make_map(np.full((60, 80), 2.0), report=metric_report(640, 480))
    plain = len(draw_map(slope_map, flat_image(640, 480)))
    doubt = Diagnostic("level-assumed", "warning", "the ground may be tilted by 9 degrees", 9.0, "give --up")
    windows = make_report()
    for told in (
        replace(slope_map, no_site="the largest safe disc has a radius of 12 px; 40 are needed"),
        replace(slope_map, report=replace(slope_map.report, diagnostics=(doubt,))),
        replace(slope_map, report=replace(slope_map.report, ambiguity=make_ambiguity(windows))),
    ):
        higher = draw_map(told, flat_image(640, 480))
        assert len(higher) > plain + 15
        assert higher[3, 3].tolist() == [130, 224, 255]


def test_pictures_are_the_same_every_time_and_leave_the_map_alone() -> None:
    slope_map = striped(sites=(make_site(1, (300.0, 300.0), 90.0),))
    before = slope_map.slope_deg.copy()
    assert np.array_equal(draw_map(slope_map, make_image(1200, 800)), draw_map(slope_map, make_image(1200, 800)))
    assert np.array_equal(slope_map.slope_deg, before)
    assert slope_map.confidence == CONFIDENCE


def test_sigma_has_the_colour_of_its_swatch() -> None:
    sigma = np.repeat((0.05, 0.15, 0.3, 0.7, 1.5, 3.0, 7.0, 15.0), 20)[None].repeat(ROWS, axis=0)
    slope_map = make_map(np.full(sigma.shape, 3.0), sigma)
    sheet = draw_sigma(slope_map, flat_image(1280, 800))[:, :, ::-1]
    for k, colour in enumerate(sigma_classes().colours):
        assert (sheet[100:700, 160 * k + 10 : 160 * k + 150] == colour).all()
        assert has_colour(sheet[800:], colour) > 300
