"""Pictures of the steps of a segmentation."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from report_factory import (
    make_camera,
    make_image,
    make_region_labels,
    make_region_report,
    make_segmentation,
)

from slopecli.products import draw_components, draw_gradient, draw_merged
from slopecli.products.drawing import NO_REGION, map_colours
from slopecli.types import Image, Report, Segmentation

SIZE = (960, 1280)  # drawn as it is, without scaling
IMAGE = Image(np.full(SIZE, 128, np.uint8))


def segmented_report(width: int = 640) -> Report:
    labels = make_region_labels(SIZE[1], SIZE[0])
    return make_region_report(make_camera(SIZE[1], SIZE[0]), labels, segmentation=make_segmentation(labels, width))


DRAW = {"gradient": draw_gradient, "components": draw_components, "merged": draw_merged}
REPORT = segmented_report()
STEPS = {name: draw(REPORT, IMAGE) for name, draw in DRAW.items()}


def test_three_pictures_as_large_as_the_overlay_with_a_caption() -> None:
    for picture in STEPS.values():
        assert picture.dtype == np.uint8
        assert picture.shape[1:] == (SIZE[1], 3)
        assert picture.shape[0] > SIZE[0] + 20
        assert (picture[SIZE[0] :] == 250).mean() > 0.5


@pytest.mark.parametrize("name", DRAW)
def test_without_a_segmentation_there_is_nothing_to_draw(name: str) -> None:
    with pytest.raises(ValueError, match="segmentation"):
        DRAW[name](make_region_report(), make_image())


def test_gradient_is_blue_below_the_threshold_and_warm_above() -> None:
    assert REPORT.segmentation is not None
    blue, _, red = STEPS["gradient"][: SIZE[0]].astype(int).transpose(2, 0, 1)
    gradient = cv2.resize(REPORT.segmentation.gradient, SIZE[::-1], interpolation=cv2.INTER_LINEAR)
    above = gradient > 1.01 * REPORT.segmentation.threshold
    below = gradient < 0.99 * REPORT.segmentation.threshold
    assert above.sum() > 1000
    assert (red > blue)[above].all()
    assert (blue > red)[below].all()


def test_gradient_says_its_threshold() -> None:
    """The mark on the colour bar moves with the threshold."""
    assert REPORT.segmentation is not None
    other = replace(REPORT, segmentation=replace(REPORT.segmentation, threshold=1.3))
    assert not np.array_equal(draw_gradient(other, IMAGE)[SIZE[0] :], STEPS["gradient"][SIZE[0] :])


def test_flat_image_has_a_picture_too() -> None:
    nothing = np.zeros((48, 64), np.int32)
    flat = Segmentation(np.zeros((48, 64), np.float32), 0.0, nothing, nothing)
    for draw in DRAW.values():
        assert draw(replace(REPORT, segmentation=flat), IMAGE).shape[1] == SIZE[1]


@pytest.mark.parametrize("name", ["components", "merged"])
def test_regions_are_told_apart_and_what_is_none_is_dark(name: str) -> None:
    """Each region has one colour on an even image, clear of its number; so has what is no region."""
    assert REPORT.segmentation is not None
    regions = cv2.resize(getattr(REPORT.segmentation, name), SIZE[::-1], interpolation=cv2.INTER_NEAREST_EXACT)
    picture = STEPS[name][: SIZE[0]].astype(int) @ [1, 256, 256**2]
    colours = {}
    for region in np.unique(regions).tolist():
        shown, counts = np.unique(picture[regions == region], return_counts=True)
        assert counts.max() > 0.5 * counts.sum()
        colours[region] = int(shown[counts.argmax()])
    assert len(set(colours.values())) == len(colours)
    light = {region: colour % 256 + colour // 256 % 256 + colour // 256**2 for region, colour in colours.items()}
    assert light.pop(0) < min(light.values())


def test_merged_regions_bear_the_ids_of_their_planes() -> None:
    plain = draw_merged(replace(REPORT, planes=()), IMAGE)
    changed = (STEPS["merged"][: SIZE[0]] != plain[: SIZE[0]]).any(axis=2)
    for plane in REPORT.planes:
        assert changed[REPORT.labels == plane.id].any()
    assert changed.mean() < 0.01


def test_pictures_are_the_same_every_time() -> None:
    again = segmented_report()
    assert all(np.array_equal(draw(again, IMAGE), STEPS[name]) for name, draw in DRAW.items())


# ---- colours ----


def cells(count: int, seed: int, gap: bool) -> np.ndarray:
    """A picture cut into cells, with or without unlabelled ground between them."""
    rng = np.random.default_rng(seed)
    v, u = np.indices((90, 120))
    centres = rng.uniform(0, 1, (count, 2)) * [120, 90]
    distance = np.hypot(u[..., None] - centres[:, 0], v[..., None] - centres[:, 1])
    labels = (1 + distance.argmin(axis=2)).astype(np.int32)
    if gap:
        first, second = np.partition(distance, 1, axis=2)[..., :2].transpose(2, 0, 1)
        labels[second - first < 3] = 0
    return labels


@pytest.mark.parametrize("gap", [False, True])
@pytest.mark.parametrize("count", [2, 7, 60, 200])
def test_neighbours_differ_in_colour(count: int, gap: bool) -> None:
    """Also across unlabelled ground: what are neighbours is known from the map without it."""
    whole, labels = cells(count, count, False), cells(count, count, gap)
    table = map_colours(labels).astype(int)
    assert tuple(table[0]) == NO_REGION
    for a, b in ((whole[:, 1:], whole[:, :-1]), (whole[1:], whole[:-1])):
        between = (a != b) & np.isin(a, labels) & np.isin(b, labels)
        assert between.any()
        assert (np.abs(table[a[between]] - table[b[between]]).sum(axis=1) > 60).all()


def test_region_with_many_neighbours_and_map_without_regions() -> None:
    """Forty small regions in a large one, and none at all."""
    labels = np.ones((50, 200), np.int32)
    for i in range(40):
        labels[20:24, 5 * i + 1 : 5 * i + 4] = i + 2
    table = map_colours(labels).astype(int)
    assert (np.abs(table[2:] - table[1]).sum(axis=1) > 60).all()
    assert map_colours(np.zeros((5, 5), np.int32)).tolist() == [list(NO_REGION)]
