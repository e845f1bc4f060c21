"""The overlay of planes found as regions: outlines, tints, labels and arrows of planes of any shape."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from report_factory import (
    make_ambiguity,
    make_camera,
    make_image,
    make_plane,
    make_region_labels,
    make_region_report,
    rectangle,
    with_level_plane,
)
from test_overlay import EUROC, flat_image, placed_on, shared_area

from slopecli.products import draw_overlay
from slopecli.products.drawing import (
    LONG_SIDE_PX,
    downhill_px,
    footprints_of,
    slope_colours,
)
from slopecli.types import Rejected, Report


def region_report(width: int = 1280, height: int = 960, **changes: object) -> Report:
    return make_region_report(make_camera(width, height), make_region_labels(width, height), **changes)


def edge_distance(labels: np.ndarray) -> np.ndarray:
    """Distance of every pixel to the nearest border between ids, or of the picture, px."""
    same = np.ones(labels.shape, np.uint8)
    same[:, 1:] &= labels[:, 1:] == labels[:, :-1]
    same[1:] &= labels[1:] == labels[:-1]
    return cv2.distanceTransform(np.pad(same, 1), cv2.DIST_L2, 5)[1:-1, 1:-1]


def test_a_map_of_planes_is_drawn_large_enough_for_its_numbers() -> None:
    picture = draw_overlay(make_region_report(), make_image())
    assert picture.shape[1] == LONG_SIDE_PX["smallest map"]
    assert draw_overlay(region_report(), flat_image(1280, 960)).shape[1] == 1280


def test_regions_are_tinted_where_they_are_and_nowhere_else() -> None:
    """Holes, pieces and what is no plane included; clear of borders, hatches and labels the colours are exact."""
    report = region_report()
    safe = tuple(replace(plane, verdict="safe", aspect_deg=None) for plane in report.planes)
    picture = draw_overlay(replace(report, planes=safe), flat_image(1280, 960))[:960]
    clear = edge_distance(report.labels) > 6
    for one in placed_on(replace(report, planes=safe), 19):
        left, top, right, bottom = np.rint(one.box).astype(int)
        clear[top - 3 : bottom + 3, left - 3 : right + 3] = False
    assert (picture[clear & (report.labels == 0)] == 128).all()
    for plane in safe:
        colour = 0.4 * 128 + 0.6 * slope_colours(plane.slope_deg)[0][::-1]
        shown = picture[clear & (report.labels == plane.id)]
        assert plane.id == 5 or len(shown) > 1000
        assert (np.abs(shown - colour) < 1.5).all()


def test_every_piece_and_every_hole_has_an_outline() -> None:
    report = region_report()
    picture = cv2.cvtColor(draw_overlay(report, flat_image(1280, 960))[:960], cv2.COLOR_BGR2GRAY).astype(int)
    for u, v in ((896, 691), (640, 300), (1152, 300), (934, 300), (154, 300)):  # pond, pieces of 4, hole of 2
        around = picture[v - 5 : v + 6, u - 5 : u + 6]
        assert np.ptp(around) > 60


def test_outlines_are_smooth() -> None:
    """A slanting border between a plane and nothing has shades between the two."""
    u, v = np.meshgrid(np.arange(1280), np.arange(960))
    labels = (v > 300 + 0.37 * u).astype(np.uint16)
    report = make_region_report(make_camera(1280, 960), labels)
    picture = draw_overlay(report, flat_image(1280, 960))[:960]
    band = np.abs(v - 300 - 0.37 * u)[:, 100:1100] < 2
    assert len(np.unique(picture[:, 100:1100][band].reshape(-1, 3), axis=0)) > 30


def test_verdicts_of_regions_differ_without_colour() -> None:
    grey = {}
    for verdict in ("safe", "unsafe", "undecided"):
        report = region_report()
        plane = replace(report.planes[1], slope_deg=15.0, aspect_deg=None, verdict=verdict)
        picture = draw_overlay(replace(report, planes=(plane,)), flat_image(1280, 960))
        grey[verdict] = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)[:960].astype(int)
    inside = np.s_[500:545, 80:560]  # below the window in it, clear of the label
    assert grey["safe"][inside].std() < 8
    assert grey["unsafe"][inside].std() > 15
    border = {name: pixels[150:500, 64:67].mean(axis=1) for name, pixels in grey.items()}
    assert border["safe"].std() < 5
    assert border["undecided"].std() > 30


def test_the_plane_taken_as_level_has_a_sign_of_its_own() -> None:
    level, other = with_level_plane(region_report()), region_report()
    (shown,) = (one for one in placed_on(level) if one.footprint.item.id == 1)
    assert (shown.label.badge, shown.footprint.verdict) == ("level", "level")
    assert any("level" in row for row in shown.label.rows)
    # its legend has one entry more
    pictures = [draw_overlay(report, flat_image(1280, 960)) for report in (level, other)]
    assert not np.array_equal(pictures[0][960:], pictures[1][960:][: len(pictures[0]) - 960])


def test_label_lies_well_inside_the_largest_piece_of_a_bent_region() -> None:
    """The centre of gravity of a ring, a horseshoe and two pieces lies outside them."""
    u, v = np.meshgrid(np.arange(1000), np.arange(800))
    labels = np.zeros((800, 1000), np.uint16)
    labels[(np.hypot(u - 250, v - 220) < 200) & (np.hypot(u - 250, v - 220) > 70)] = 1
    labels[(u > 500) & (v < 400) & ((u < 640) | (u > 850) | (v < 130))] = 2
    labels[(v > 500) & ((u < 400) | (u > 820))] = 3
    report = make_region_report(make_camera(1000, 800), labels)
    placed = placed_on(report)
    assert sorted(one.footprint.item.id for one in placed) == [1, 2, 3]
    for one in placed:
        left, top, right, bottom = np.rint(one.box).astype(int)
        assert (labels[top:bottom, left:right] == one.footprint.item.id).all()
        assert "±" in " ".join(one.label.rows)
        tip = np.rint(one.arrow_tail + one.arrow_length * one.footprint.downhill).astype(int)
        assert labels[tip[1], tip[0]] == one.footprint.item.id
        if one.footprint.item.id == 3:
            assert one.box[2] < 400  # of its two pieces the larger


def test_specks_without_a_plane_do_not_drive_a_label_away() -> None:
    labels = np.ones((600, 800), np.uint16)
    labels[np.random.default_rng(2).random(labels.shape) < 0.03] = 0
    (one,) = placed_on(make_region_report(make_camera(800, 600), labels))
    assert "±" in " ".join(one.label.rows)
    assert np.abs(one.centre - [400, 300]).max() < 90


def test_arrow_of_a_region_is_the_fall_line_where_its_label_is() -> None:
    report = region_report()
    for one in footprints_of(report, 1.0, report.labels.shape, 15):
        pole = one.centre
        assert report.labels[int(pole[1]), int(pole[0])] == one.item.id
        np.testing.assert_allclose(one.downhill, downhill_px(report, one.item, pole))


def many_planes(count: int, seed: int = 4) -> np.ndarray:
    """A picture of 800 x 600 px cut into cells of very different size, with gaps between them."""
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid(np.arange(200.0), np.arange(150.0))
    centres = np.abs(rng.normal(0, 0.5, (count, 2))) % 1 * [200, 150]
    distance = np.hypot(u[..., None] - centres[:, 0], v[..., None] - centres[:, 1])
    labels = np.kron(1 + distance.argmin(axis=2), np.ones((4, 4))).astype(np.uint16)
    labels[edge_distance(labels) < 1.5] = 0
    return labels


def test_sixty_planes_have_a_legible_number_each() -> None:
    labels = many_planes(60)
    report = make_region_report(make_camera(800, 600), labels)
    placed = placed_on(report, 12)
    assert [one.label.rows[0].split(":")[0] for one in placed] == [str(one.footprint.item.id) for one in placed]
    assert len({one.footprint.item.id for one in placed}) == len(placed) == len(report.planes)
    assert min(one.label.size for one in placed) >= 9
    assert max(shared_area(a, b) for i, a in enumerate(placed) for b in placed[:i]) == 0
    assert sum(len(" ".join(one.label.rows)) > 3 for one in placed) > 30  # half say their slope too
    for one in placed:
        assert one.outside or labels[tuple(np.rint(one.centre[::-1]).astype(int))] in (0, one.footprint.item.id)


def test_tiny_region_has_its_number_only() -> None:
    labels = np.zeros((600, 800), np.uint16)
    labels[300:312, 400:412] = 7
    (one,) = placed_on(make_region_report(make_camera(800, 600), labels), 12)
    assert one.label.rows == ("7",)
    assert np.abs(one.centre - 5.5 - [400, 300]).max() < 4


def test_refused_regions_do_not_cover_planes() -> None:
    report = region_report()
    refused = (Rejected(9, rectangle(10, 10, 900, 940), "low-texture", "12 of 20"),)
    plain = draw_overlay(report, flat_image(1280, 960))[:960]
    picture = draw_overlay(replace(report, rejected=refused), flat_image(1280, 960))[:960]
    changed = (picture != plain).any(axis=2)
    inner = cv2.erode((report.labels > 0).astype(np.uint8), np.ones((5, 5))) > 0
    assert changed[(report.labels == 0) & (np.arange(1280) < 900)].mean() > 0.5
    assert not changed[inner].any()


def test_second_answer_stands_on_regions_too() -> None:
    report = region_report()
    doubtful = replace(report, ambiguity=make_ambiguity(report))
    label = next(one.label for one in placed_on(doubtful) if one.footprint.item.id == 1)
    assert "or 32.0°" in label.rows


def test_region_reports_of_any_shape_are_drawn_the_same_every_time() -> None:
    unseen = make_region_report()
    unseen = replace(unseen, planes=(*unseen.planes, replace(unseen.planes[0], id=99, source="ransac", found=True)))
    window = make_plane(50, rectangle(600, 10, 30, 30), 5.0)
    mixed = replace(unseen, planes=(*unseen.planes, window))
    for report in (unseen, mixed, make_region_report(EUROC)):
        camera = report.cameras[0]
        image = make_image(camera.width, camera.height, colour=True)
        assert np.array_equal(draw_overlay(report, image), draw_overlay(report, image))
