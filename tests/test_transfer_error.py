"""Photometric comparison of planes: low cost for the true one, high for others."""

from __future__ import annotations

import numpy as np
import pytest
from scenery import make_camera, render, tilted, turn, unit

from slopecli.geometry import pixels_from_rays, rays_from_pixels
from slopecli.look import DIFFERENCE_GREY, OUTSIDE, TRUNCATED_COST, Comparison, Grid, Pyramid, View, shrink
from slopecli.types import Camera

R, T = turn(0.5, 1.0, 0.3), unit(1.0, 0.2, 0.1)
TRUE = tilted(0.2, -0.1, 8.0)
INNER = np.mgrid[40:200:4, 60:220:4].reshape(2, -1)
POINTS = INNER[0], INNER[1]
LENS = make_camera(model="brown", distortion=(-0.15, 0.05, 0.001, -0.001))


def comparison_of(
    camera: Camera | None = None, noise: float = 0.0, pixels: float = 1e9, camera2: Camera | None = None
) -> Comparison:
    pair = render(R, T, [TRUE], noise=noise, camera1=camera, camera2=camera2 or camera)
    grey, scale = shrink(pair.grey1, pixels)
    view = View(
        Grid(grey, 0.0, 0.0, scale),
        lambda uv: rays_from_pixels(pair.camera1, uv),
        lambda rays: pixels_from_rays(pair.camera2, rays),
        R,
        T,
        Pyramid(pair.grey2),
        pair.grey2.shape,
    )
    return Comparison(view, (pair.camera1.focal_px, pair.camera2.focal_px))


@pytest.mark.parametrize("camera", [None, LENS], ids=["pinhole", "lens"])
def test_the_true_plane_costs_hardly_anything_and_another_much(camera: Camera | None) -> None:
    comparison = comparison_of(camera)
    assert comparison.cost(TRUE)[POINTS].mean() < 0.1
    assert comparison.cost(TRUE * 1.1)[POINTS].mean() > 3.0


def test_a_part_of_the_image_costs_what_it_costs_in_the_whole() -> None:
    comparison = comparison_of(LENS, noise=2.0)
    cost = comparison.cost(TRUE * 1.02)
    assert cost.shape == comparison.shape
    box = slice(80, 160), slice(64, 200)
    assert comparison.cost(TRUE * 1.02, box) == pytest.approx(cost[box], abs=0.3)


def test_pixels_sent_outside_image_2_cost_the_most() -> None:
    comparison = comparison_of()
    cost = comparison.cost(TRUE * 3)
    assert cost.max() == OUTSIDE > TRUNCATED_COST
    assert (comparison.cost(-TRUE) == OUTSIDE).all()


@pytest.mark.parametrize("size", [0.5, 2.0, 3.0])
def test_image_2_of_another_size_is_compared_as_well(size: float) -> None:
    other = comparison_of(noise=1.0, camera2=make_camera(int(320 * size), int(240 * size)))
    assert other.cost(TRUE)[POINTS].mean() < 1.0
    assert other.cost(TRUE * 1.1)[POINTS].mean() > 3.0


def test_noise_costs_about_its_variance_and_a_plane_two_pixels_off_several_times_as_much() -> None:
    noisy = comparison_of(noise=DIFFERENCE_GREY / np.sqrt(2))
    assert noisy.cost(TRUE)[POINTS].mean() < 1.0
    assert noisy.cost(TRUE * 1.06)[POINTS].mean() > 4.0


def test_pixels_the_lens_has_no_ray_for_cost_the_most() -> None:
    comparison = comparison_of(make_camera(model="brown", distortion=(-0.9,)), noise=1.0)
    cost = comparison.cost(TRUE)
    assert (cost[:3, :3] == OUTSIDE).all()
    assert cost[100:140, 120:200].mean() < 1.0
