"""Regions merged where they are one plane, and planes fitted to their regions."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scenery import Surface, make_camera, pixel_grid, render, tilted, turn, unit

from slopecli.geometry import normal_angle, pixels_from_rays, rays_from_pixels
from slopecli.look import Comparison, Grid, Pyramid, View
from slopecli.patches.regions import Labelled, merged, refitted
from slopecli.types import FloatArray

R, T = turn(0.5, 1.0, 0.3), unit(1.0, 0.15, 0.05)
GROUND = tilted(0.0, -0.25, 8.0)
STEP = GROUND * 1.1  # parallel to the ground: image 2 shows it 3 px from where the ground would be
STEP_BOX = (180, 60, 90, 120)


@lru_cache(maxsize=1)
def seen() -> tuple[Comparison, np.ndarray]:
    """Ground with a step, and its true labels 1, 2."""
    camera = make_camera()
    pair = render(R, T, [Surface(GROUND), Surface(STEP, STEP_BOX)], camera1=camera, noise=1.0)
    view = View(
        Grid(pair.grey1, 0.0, 0.0, np.ones(2)),
        lambda uv: rays_from_pixels(camera, uv),
        lambda rays: pixels_from_rays(camera, rays),
        R,
        T,
        Pyramid(pair.grey2),
        pair.grey2.shape,
    )
    comparison = Comparison(view, (camera.focal_px, camera.focal_px))
    labels = 1 + pair.surface_at(pixel_grid(320, 240).reshape(-1, 2)).reshape(240, 320)
    labels[:, :60] = 0  # image 2 does not show it
    return comparison, labels.astype(np.int32)


def in_three(labels: np.ndarray) -> np.ndarray:
    """The ground cut in two as well: 1 its larger part, 2 the step, 3 what lies above row 90."""
    parts = labels.copy()
    parts[:90][labels[:90] == 1] = 3
    return parts


def merge(labels: np.ndarray, planes: list[FloatArray], merge_px: float = 1.0) -> Labelled:
    return merged(seen()[0], Labelled(planes, labels), merge_px, np.random.default_rng(0))


def test_two_parts_of_one_plane_become_one_and_what_stands_off_it_stays() -> None:
    _, labels = seen()
    found = merge(in_three(labels), [GROUND, STEP, GROUND * 1.005])
    assert np.array_equal(found.labels, labels)
    assert len(found.planes) == 2
    assert np.degrees(normal_angle(found.planes[0], GROUND)) < 0.3


def test_planes_that_send_pixels_farther_apart_than_told_are_not_tried() -> None:
    _, labels = seen()
    parts, planes = in_three(labels), [GROUND, STEP, GROUND * 1.01]
    apart = seen()[0].apart_px(np.nonzero(parts == 3), planes[2], GROUND[None])[0]
    assert len(merge(parts, planes, 0.8 * apart).planes) == 3
    assert len(merge(parts, planes, 1.3 * apart).planes) == 2


def test_parallel_planes_stay_apart_however_far_merging_may_reach() -> None:
    _, labels = seen()
    assert np.array_equal(merge(labels, [GROUND, STEP], 50.0).labels, labels)


def test_one_plane_or_none_is_left_as_it_is() -> None:
    _, labels = seen()
    assert len(merge(np.minimum(labels, 1), [GROUND]).planes) == 1
    assert merge(np.zeros_like(labels), []).planes == []


def test_planes_are_fitted_to_their_regions() -> None:
    comparison, labels = seen()
    found = refitted(comparison, Labelled([GROUND * 1.01, STEP * 0.99], labels), np.random.default_rng(0))
    for plane, true in zip(found.planes, (GROUND, STEP), strict=True):
        assert np.linalg.norm(plane - true) < 2e-3 * np.linalg.norm(true)
    assert np.array_equal(found.labels, labels)


def test_a_plane_of_a_few_pixels_is_not_fitted() -> None:
    comparison, labels = seen()
    crumbs = np.where(labels == 1, 1, 0).astype(np.int32)
    crumbs[100:105, 200:205] = 2
    found = refitted(comparison, Labelled([GROUND, STEP], crumbs), np.random.default_rng(0))
    assert np.array_equal(found.planes[1], STEP)


@pytest.mark.parametrize(("least", "areas"), [(1, [50, 30, 10]), (20, [50, 30]), (60, [])])
def test_planes_are_numbered_by_size_and_small_ones_dropped(least: float, areas: list[int]) -> None:
    labels = np.repeat([2, 0, 3, 1, 4], [30, 7, 50, 10, 0]).astype(np.int32)[None]
    planes = [np.full(3, float(k)) for k in (1, 2, 3, 4)]
    found = Labelled(planes, labels).by_size(least)
    assert [int((found.labels == k + 1).sum()) for k in range(len(found.planes))] == areas
    assert [plane[0] for plane in found.planes] == [3.0, 2.0, 1.0][: len(areas)]
