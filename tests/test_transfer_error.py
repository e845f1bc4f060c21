"""Photometric comparison of planes: low cost for the true one, which a fit finds again."""

from __future__ import annotations

import numpy as np
import pytest
from scenery import make_camera, render, tilted, turn, unit

from slopecli.geometry import (
    apply_homography,
    homography_in_pixels,
    homography_of_plane,
    normal_angle,
    pixels_from_rays,
    rays_from_pixels,
)
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
    assert cost.max() == OUTSIDE > TRUNCATED_COST
    assert (comparison.cost(-TRUE) == OUTSIDE).all()


@pytest.mark.parametrize("camera", [None, LENS], ids=["pinhole", "lens"])
def test_a_fit_finds_the_plane_from_half_a_pixel_off(camera: Camera | None) -> None:
    comparison = comparison_of(camera, noise=1.0)
    start = TRUE + np.array([0.004, -0.003, 0.002])
    assert 0.3 < comparison.apart_px(POINTS, start, TRUE[None])[0] < 1.5
    found = comparison.fit(POINTS, start)
    assert comparison.apart_px(POINTS, found, TRUE[None])[0] < 0.05
    assert np.degrees(normal_angle(found, TRUE)) < 0.3


@pytest.mark.parametrize("size", [0.5, 2.0, 3.0])
def test_image_2_of_another_size_is_compared_as_well(size: float) -> None:
    other = comparison_of(noise=1.0, camera2=make_camera(int(320 * size), int(240 * size)))
    assert other.cost_at(POINTS, TRUE).mean() < 1.0
    assert other.cost_at(POINTS, TRUE * 1.1).mean() > 3.0
    # what counts is px of image 1, whatever image 2 has
    alike = comparison_of().apart_px(POINTS, TRUE, TRUE[None] * 1.03)
    assert other.apart_px(POINTS, TRUE, TRUE[None] * 1.03) == pytest.approx(alike, rel=0.01)
    found = other.fit(POINTS, TRUE + np.array([0.004, -0.003, 0.002]))
    assert np.degrees(normal_angle(found, TRUE)) < 0.3


def displaced(px: float) -> np.ndarray:
    """A plane parallel to the true one that sends the pixels this far from where it does."""
    per_unit = comparison_of().apart_px(POINTS, TRUE, TRUE[None] * 1.01)[0] / 0.01
    return TRUE * (1 + px / per_unit)


def test_noise_costs_about_its_variance_and_a_plane_two_pixels_off_several_times_as_much() -> None:
    noisy = comparison_of(noise=DIFFERENCE_GREY / np.sqrt(2))
    assert noisy.cost_at(POINTS, TRUE).mean() < 1.0
    assert noisy.cost_at(POINTS, displaced(2.0)).mean() > 4.0


@pytest.mark.parametrize(("pixels", "working_px"), [(1e9, 1.0), (320 * 240 / 4, 0.5)], ids=["full", "half"])
def test_planes_are_as_far_apart_as_they_send_pixels(pixels: float, working_px: float) -> None:
    comparison, K = comparison_of(pixels=pixels), make_camera().K
    rows, columns = POINTS[0] // 2, POINTS[1] // 2
    uv1 = comparison.grid.full(np.column_stack([columns, rows]).astype(float))
    others = np.array([TRUE, TRUE * 1.03, tilted(0.3, -0.1, 8.0)])
    sent = [apply_homography(homography_in_pixels(homography_of_plane(R, T, n), K, K), uv1) for n in others]
    expected = [np.median(np.linalg.norm(uv2 - sent[0], axis=1)) * working_px for uv2 in sent]
    assert comparison.apart_px((rows, columns), TRUE, others) == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_pixels_the_lens_has_no_ray_for_do_not_stop_a_fit() -> None:
    comparison = comparison_of(make_camera(model="brown", distortion=(-0.9,)), noise=1.0)
    rows, columns = np.mgrid[100:140:2, 120:200:2].reshape(2, -1)
    start = TRUE + np.array([0.004, -0.003, 0.002])
    found = comparison.fit((rows, columns), start)
    assert np.degrees(normal_angle(found, TRUE)) < 0.3
    assert np.array_equal(comparison.fit((np.append(rows, 0), np.append(columns, 0)), start), found)
    assert np.array_equal(comparison.fit((np.arange(9), np.arange(9)), start), start)  # none has a ray


def test_a_fit_leaves_a_plane_alone_that_image_2_does_not_show() -> None:
    away = TRUE * 30
    assert np.array_equal(comparison_of().fit(POINTS, away), away)
