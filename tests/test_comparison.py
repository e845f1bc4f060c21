"""Photometric comparison of planes: low cost for the true one, which a fit finds again."""

from __future__ import annotations

import numpy as np
import pytest
from scenery import make_camera, render, tilted, turn, unit

from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.geometry.metrics import normal_angle
from slopecli.types import Camera
from slopecli.vision.comparison import OUTSIDE, TRUNCATED, Comparison
from slopecli.vision.warp import Grid, Pyramid

R, T = turn(0.5, 1.0, 0.3), unit(1.0, 0.2, 0.1)
TRUE = tilted(0.2, -0.1, 8.0)
INNER = np.mgrid[40:200:4, 60:220:4].reshape(2, -1)
POINTS = INNER[0], INNER[1]
LENS = make_camera(model="brown", distortion=(-0.15, 0.05, 0.001, -0.001))


def comparison_of(camera: Camera | None = None, noise: float = 0.0) -> Comparison:
    pair = render(R, T, [TRUE], noise=noise, camera1=camera, camera2=camera)
    return Comparison(
        Grid(pair.grey1, 0.0, 0.0, np.ones(2)),
        lambda uv: rays_from_pixels(pair.camera1, uv),
        lambda rays: pixels_from_rays(pair.camera2, rays),
        R,
        T,
        Pyramid(pair.grey2),
        pair.grey2.shape,
        pair.camera2.focal_px,
    )


@pytest.mark.parametrize("camera", [None, LENS], ids=["pinhole", "lens"])
def test_the_true_plane_costs_hardly_anything_and_another_much(camera: Camera | None) -> None:
    comparison = comparison_of(camera)
    assert comparison.cost_at(POINTS, TRUE).mean() < 0.1
    assert comparison.cost_at(POINTS, TRUE * 1.1).mean() > 3.0


def test_the_map_of_costs_is_that_of_single_pixels() -> None:
    comparison = comparison_of(LENS, noise=2.0)
    for normal in (TRUE, TRUE * 1.02):
        cost = comparison.cost(normal)
        assert cost.shape == comparison.shape
        assert cost[POINTS] == pytest.approx(comparison.cost_at(POINTS, normal), abs=0.5)
        assert np.array_equal(comparison.cost(normal, 2), cost[::2, ::2])


def test_pixels_sent_outside_image_2_cost_the_most() -> None:
    comparison = comparison_of()
    cost = comparison.cost(TRUE * 3)
    assert cost.max() == OUTSIDE > TRUNCATED
    assert (comparison.cost(-TRUE) == OUTSIDE).all()


@pytest.mark.parametrize("camera", [None, LENS], ids=["pinhole", "lens"])
def test_a_fit_finds_the_plane_from_half_a_pixel_off(camera: Camera | None) -> None:
    comparison = comparison_of(camera, noise=1.0)
    start = TRUE + np.array([0.004, -0.003, 0.002])
    assert 0.3 < comparison.apart_px(POINTS, start, TRUE[None])[0] < 1.5
    found = comparison.fit(POINTS, start)
    assert comparison.apart_px(POINTS, found, TRUE[None])[0] < 0.05
    assert np.degrees(normal_angle(found, TRUE)) < 0.3
