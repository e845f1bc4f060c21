"""The overlay: what a person sees on it, at any size of image and of window."""

from __future__ import annotations

import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
from report_factory import (
    grid_polygons,
    make_ambiguity,
    make_camera,
    make_image,
    make_plane,
    make_region_report,
    make_report,
    normal_of,
    rectangle,
)

from slopecli.geometry import pixels_from_rays, rays_from_pixels
from slopecli.products import draw_overlay
from slopecli.products.drawing import (
    LONG_SIDE_PX,
    Footprint,
    Placed,
    downhill_px,
    footprints_of,
    place_labels,
    slope_colours,
    slope_text,
    text_width,
    wrapped,
)
from slopecli.report import SLOPE_UNITS
from slopecli.types import Camera, Image, Plane, Rejected, Report, Up

EUROC = Camera(752, 480, 458.7, 457.3, 367.2, 248.4, "brown", (-0.283, 0.074, 1.9e-4, 1.8e-5))


def flat_image(width: int = 640, height: int = 480) -> Image:
    return Image(np.full((height, width), 128, np.uint8))


def placed_labels(polygons: list[np.ndarray], side: int = 1024, text_px: int = 15) -> list[Placed]:
    report = make_report(make_camera(side, side), polygons)
    return place_labels([footprint(report, plane) for plane in report.planes], [], (side, side), text_px)


def footprint(report: Report, plane: Plane) -> Footprint:
    """Of a plane whose polygon is a rectangle."""
    (left, top), (right, bottom) = plane.polygon_px[0].astype(int), plane.polygon_px[2].astype(int)
    mask = np.full((bottom - top + 1, right - left + 1), 255, np.uint8)
    return Footprint(plane, plane.polygon_px, mask, (int(left), int(top)), downhill_px(report, plane))


def placed_on(report: Report, text_px: int = 15) -> list[Placed]:
    """Labels of a report drawn at the size of its image."""
    shape = report.labels.shape
    return place_labels(footprints_of(report, 1.0, shape, text_px), [], shape, text_px)


def shared_area(a: Placed, b: Placed) -> float:
    sides = np.minimum(a.box[2:], b.box[2:]) - np.maximum(a.box[:2], b.box[:2])
    return float(np.prod(np.maximum(sides, 0)))


# ---- size ----


@pytest.mark.parametrize(
    ("width", "height"),
    [(640, 480), (1024, 1024), (200, 150), pytest.param(5472, 3648, marks=pytest.mark.slow), (300, 900), (64, 64)],
)
def test_long_side_is_kept_between_the_limits(width: int, height: int) -> None:
    picture = draw_overlay(make_report(make_camera(width, height)), make_image(width, height))
    drawn = round(
        width * np.clip(1, LONG_SIDE_PX["smallest"] / max(width, height), LONG_SIDE_PX["largest"] / max(width, height))
    )
    assert picture.dtype == np.uint8
    assert picture.shape[1] == drawn
    assert picture.shape[0] > round(height / width * drawn)  # the legend is below, not on the image


def test_same_report_gives_same_pixels_and_leaves_the_image_alone() -> None:
    image, report = make_image(colour=True), make_report()
    before = image.grey.copy(), image.colour.copy()
    assert np.array_equal(draw_overlay(report, image), draw_overlay(report, image))
    assert np.array_equal(image.grey, before[0])
    assert np.array_equal(image.colour, before[1])


def test_a_megapixel_takes_well_under_a_fifth_of_a_second() -> None:
    """0.03-0.05 s of processor time when measured; the limit leaves four times that for a busy machine."""
    report, image = make_report(make_camera(1024, 1024)), make_image(1024, 1024)
    spent = []
    for _ in range(4):
        start = time.process_time()
        draw_overlay(report, image)
        spent.append(time.process_time() - start)
    assert min(spent) < 0.2


# ---- colour and verdict ----


def test_colours_run_from_blue_to_yellow_and_stop_at_the_ends() -> None:
    level, steep = slope_colours([0, 30]).astype(int)
    assert level[2] > level[0] + 60
    assert steep[0] > steep[2] + 100
    assert np.array_equal(slope_colours([-5, 90]), slope_colours([0, 30]))


def test_lightness_alone_tells_slopes_apart() -> None:
    lightness = slope_colours(np.linspace(0, 30, 7)) @ [0.299, 0.587, 0.114]
    assert np.all(np.diff(lightness) > 15)


def test_patch_shows_the_colour_of_its_slope() -> None:
    polygons = grid_polygons(640, 480, 3, 3)
    picture = draw_overlay(make_report(polygons=polygons), flat_image())
    for plane in make_report(polygons=polygons).planes:
        u, v = plane.polygon_px[0].astype(int) + 20
        shown = np.median(picture[v : v + 12, u : u + 40].reshape(-1, 3), axis=0)[::-1]
        assert np.abs(shown - (0.4 * 128 + 0.6 * slope_colours(plane.slope_deg)[0])).max() < 3


def test_verdicts_differ_without_colour() -> None:
    """Same slope, other verdict: hatch and border tell them apart on a grey print."""
    grey = {}
    for verdict in ("safe", "unsafe", "undecided"):
        plane = make_plane(1, rectangle(20, 20, 400, 300), 15.0, aspect_deg=None, verdict=verdict)
        picture = draw_overlay(make_report(planes=(plane,), rejected=(), epipole1_px=None), flat_image())
        grey[verdict] = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)[:480].astype(int)
    inside = np.s_[40:120, 40:400]  # clear of border and label
    assert grey["safe"][inside].std() < 1
    assert grey["unsafe"][inside].std() > 10
    border = {name: pixels[20:23, 24:416].mean(axis=0) for name, pixels in grey.items()}
    assert border["safe"].std() < 5  # solid
    assert border["undecided"].std() > 40  # dashed


def test_refused_window_is_hatched_and_grey() -> None:
    refused = Rejected(1, rectangle(20, 20, 400, 300), "low-texture", "12 of 20")
    picture = draw_overlay(make_report(planes=(), rejected=(refused,)), flat_image())[40:120, 40:400].astype(int)
    assert np.ptp(picture, axis=2).max() <= 2
    assert picture.std() > 10


def unknown_plane(**changes: object) -> Plane:
    fields = {"slope_known": False, "status": "poor", "verdict": "undecided", **changes}
    return make_plane(1, rectangle(20, 20, 400, 300), 24.0, 14.0, **fields)  # type: ignore[arg-type]


def test_a_slope_that_is_not_known_has_no_colour_no_number_and_no_arrow() -> None:
    plane = unknown_plane(aspect_deg=60.0)
    report = make_report(planes=(plane,), rejected=(), epipole1_px=None)
    picture = draw_overlay(report, flat_image())[:480].astype(int)
    assert np.ptp(picture[40:120, 40:400], axis=2).max() <= 2
    assert picture[40:120, 40:400].std() > 10
    steeper = replace(report, planes=(replace(plane, slope_deg=3.0, aspect_deg=None),))
    assert np.array_equal(draw_overlay(steeper, flat_image())[:480], picture)
    (one,) = place_labels(footprints_of(report, 1.0, (480, 640), 15), [], (480, 640), 15)
    assert one.label.rows == ("1 ?", "± 14°")
    assert one.label.badge == "rejected"
    assert one.footprint.downhill is None


def test_too_steep_for_certain_has_its_badge_where_the_slope_is_not_known() -> None:
    report = make_report(planes=(unknown_plane(verdict="unsafe"),), rejected=())
    (one,) = place_labels(footprints_of(report, 1.0, (480, 640), 15), [], (480, 640), 15)
    assert (one.footprint.verdict, one.label.badge) == ("rejected", "unsafe")


def test_small_patches_of_unknown_slope_show_no_number_either() -> None:
    planes = [replace(p, slope_known=False) for p in make_report(polygons=grid_polygons(640, 480, 24, 24)).planes]
    report = make_report(planes=tuple(planes), rejected=())
    placed = place_labels(footprints_of(report, 1.0, (480, 640), 15), [], (480, 640), 15)
    assert {one.label.rows[1:] for one in placed} == {("?",)}
    region = make_region_report()
    region = replace(region, planes=tuple(replace(p, slope_known=False) for p in region.planes))
    assert not any("°" in row.replace("± ", "") and "±" not in row for p in placed_on(region) for row in p.label.rows)


# ---- pointers ----


@pytest.mark.parametrize("camera", [make_camera(752, 480), EUROC], ids=["pinhole", "distorted"])
@pytest.mark.parametrize("up", [(0.0, 0.0, -1.0), (0.0, -0.6, -0.8)])
def test_arrow_is_the_image_of_the_fall_line(camera: Camera, up: tuple[float, float, float]) -> None:
    """Against the projection of a short step downhill on the plane, lens included, to 0.5 deg."""
    middle = np.array([560.0, 370.0])
    for azimuth in (10, 100, 190, 280):
        normal = normal_of(20, azimuth)
        plane = make_plane(1, rectangle(*(middle - 30), 60, 60), 20, camera=camera, normal_cam1=normal)
        report = make_report(camera, [plane.polygon_px], planes=(plane,), up=Up(up, "given"))
        ray = np.append(rays_from_pixels(camera, middle[None])[0], 1.0)
        point = ray * plane.distance / -(ray @ normal)
        fall = (np.array(up) @ normal) * normal - up
        step = point + 1e-3 * fall
        assert (step - point) @ up < 0
        ends = pixels_from_rays(camera, np.array([point[:2] / point[2], step[:2] / step[2]]))
        expected = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        assert downhill_px(report, plane) @ expected > np.cos(np.radians(0.5))


def test_level_plane_has_no_arrow() -> None:
    report = make_report()
    level = next(plane for plane in report.planes if plane.aspect_deg is None)
    assert downhill_px(report, level) is None


def test_focus_is_marked_where_it_is_and_only_inside() -> None:
    picture, without, outside = (
        draw_overlay(make_report(planes=(), rejected=(), epipole1_px=where), flat_image())[:480].astype(int)
        for where in ((200.0, 150.0), None, (900.0, 150.0))
    )
    rows, columns = np.nonzero(np.abs(picture - without).sum(axis=2))
    assert np.hypot(rows.mean() - 150, columns.mean() - 200) < 1.5
    assert np.array_equal(outside, without)


def test_banner_says_when_there_are_two_answers() -> None:
    report = make_report()
    plain = draw_overlay(report, make_image())
    resolved = draw_overlay(replace(report, ambiguity=replace(make_ambiguity(report), status="resolved")), make_image())
    doubtful = draw_overlay(replace(report, ambiguity=make_ambiguity(report)), make_image())
    assert np.array_equal(resolved[:480], plain[:480])  # the picture; a line of the legend says what was ruled out
    assert not np.array_equal(resolved[480:], plain[480:])
    assert doubtful.shape[0] > plain.shape[0] + 10
    assert not np.array_equal(doubtful[-plain.shape[0] :], plain)  # the other slope stands on every patch


# ---- labels ----


@pytest.mark.parametrize("columns", [3, 6, 10])
def test_labels_stay_in_their_windows_and_apart(columns: int) -> None:
    placed = placed_labels(grid_polygons(1024, 1024, columns, columns))
    assert len(placed) == columns**2 - 1
    for one in placed:
        low, high = one.footprint.polygon.min(axis=0), one.footprint.polygon.max(axis=0)
        assert (low - 1 <= one.box[:2]).all()
        assert (one.box[2:] <= high + 1).all()
    assert max(shared_area(a, b) for i, a in enumerate(placed) for b in placed[:i]) == 0


def test_small_windows_are_labelled_beside_and_in_full() -> None:
    corners = [(10, 10), (500, 500), (545, 500), (980, 980), (100, 700), (300, 300), (700, 20)]
    polygons = [rectangle(*corner, 40, 40) for corner in corners]
    placed = placed_labels(polygons)
    assert all(one.outside for one in placed)
    assert all("±" in one.label.rows[1] for one in placed)
    for one in placed:
        assert min(one.box) >= 0
        assert max(one.box) <= 1024
        assert np.linalg.norm(one.centre - one.footprint.centre) < 110
        for polygon in polygons:
            low, high = polygon.min(axis=0), polygon.max(axis=0)
            assert (np.maximum(one.box[:2], low) >= np.minimum(one.box[2:], high)).any(), "covers a window"
    assert max(shared_area(a, b) for i, a in enumerate(placed) for b in placed[:i]) == 0


def test_a_dense_grid_still_shows_id_and_slope_of_every_window() -> None:
    placed = placed_labels(grid_polygons(1024, 1024, 24, 24))
    assert len(placed) == 24**2 - 1
    assert all(len(one.label.rows) == 2 and one.label.size >= 9 for one in placed)


def test_slope_text_shows_as_many_digits_as_mean_something() -> None:
    def text(slope: float, sigma: float) -> tuple[str, str]:
        return slope_text(make_plane(1, rectangle(0, 0, 9, 9), slope, slope_sigma_deg=sigma))

    assert text(12.34, 0.42) == ("12.3°", "± 0.4°")
    assert text(12.34, 0.056) == ("12.3°", "± 0.06°")
    assert text(12.34, 14.7) == ("12°", "± 15°")
    assert text(12.34, 0.004) == ("12.3°", "± <0.01°")
    assert text(12.34, float("nan")) == ("12.3°", "")


@pytest.mark.parametrize(("unit", "told"), [("percent", ("26.8 %", "± 0.9")), ("x-in-12", ("3.22 in 12", "± 0.11"))])
def test_labels_are_in_the_unit_asked_for_and_walls_in_degrees(unit: str, told: tuple[str, str]) -> None:
    plane = replace(make_report().planes[0], slope_deg=15.0, slope_sigma_deg=0.5)
    assert slope_text(plane, SLOPE_UNITS[unit]) == told
    assert slope_text(replace(plane, slope_deg=89.0), SLOPE_UNITS[unit]) == slope_text(replace(plane, slope_deg=89.0))
    report = make_report()
    degrees, other = (
        draw_overlay(replace(report, options={**report.options, "slope_unit": one}), make_image())
        for one in ("deg", unit)
    )
    assert degrees.shape == other.shape
    assert (degrees != other).any()


def test_long_sentences_are_broken_to_the_width() -> None:
    sentence = "a second motion fits these images as well " * 6
    lines = wrapped(sentence, 14, 300)
    assert " ".join(lines) == sentence.strip()
    assert max(text_width(line, 14) for line in lines) <= 300


# ---- odd reports ----


def test_odd_reports_are_drawn() -> None:
    camera = make_camera()
    outside = make_plane(1, rectangle(700, 500, 60, 60), 5)
    half_outside = make_plane(2, rectangle(-50, -40, 120, 90), 25)
    twins = [make_plane(i, rectangle(200, 200, 80, 80), 10) for i in (3, 4)]
    sliver = make_plane(5, rectangle(300, 100, 200, 0.2), 10)
    vertical = make_plane(6, rectangle(400, 300, 100, 100), 90, camera=camera)
    unknown = make_plane(7, rectangle(20, 300, 100, 100), 12, slope_sigma_deg=float("nan"), status="poor", reason="?")
    refused = Rejected(8, rectangle(150, 320, 100, 60), "γ ≤ 3 \U0001f680", "not in the font")
    report = make_report(camera, planes=(outside, half_outside, *twins, sliver, vertical, unknown), rejected=(refused,))
    assert draw_overlay(report, make_image()).shape[1] == 640
    assert draw_overlay(make_report(planes=(), rejected=(), options={}), make_image()).shape[1] == 640


def test_tolerance_beyond_the_colours_is_still_in_the_words() -> None:
    report = make_report(options={"tolerance_deg": 40.0, "confidence": 0.9})
    assert draw_overlay(report, make_image()).shape[1] == 640
