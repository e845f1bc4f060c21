"""Covariance of the planes of footprints: by the motion against other motions, by noise against simulated noise."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
import pytest
from depth_scenes import scene_of, true_depth
from scenery import Pair, Surface, render, tilted, turn, unit

from slopecli.geometry import (
    homogeneous,
    inverse_depth,
    pixels_from_rays,
    rays_from_pixels,
    rotation_from_vector,
    tangent_basis,
)
from slopecli.ground import (
    Cells,
    FootprintPlanes,
    Root,
    across_step,
    fit_footprints,
    gradient_parts,
    largest_jump,
    normal_covariance,
    normals_under,
    wholly_shown,
)
from slopecli.look import DenseDepth, measure_depth
from slopecli.types import Camera, FloatArray

R, T, GROUND = turn(1, -2, 3), unit(0.8, 0.2, 0.4), tilted(0.2, -0.1)
CELLS = Cells(np.arange(130, 300, 20), np.arange(30, 220, 20), 16.0)


@lru_cache(maxsize=1)
def ground() -> tuple[Pair, DenseDepth]:
    """A plane, and its true depth."""
    pair = render(R, T, [GROUND])
    return pair, true_depth(measure_depth(scene_of(pair)), pair)


def planes_of(depth: DenseDepth, cells: Cells = CELLS) -> FootprintPlanes:
    return fit_footprints(depth.points, depth.known, depth.sure, cells)


def root_of(covariance: FloatArray | None = None, focal_sigma: float = 0.0) -> Root:
    exact = np.zeros((5, 5)) if covariance is None else covariance
    return Root(R, T, exact, tangent_basis(T), focal_sigma, np.zeros(5))


def no_jump(planes: FootprintPlanes) -> FloatArray:
    return np.zeros(planes.cells.shape)


# ---- by the motion ----


@pytest.mark.parametrize(
    ("turned", "moved"),
    [((0.001, 0, 0), (0, 0, 0)), ((0, -0.002, 0.003), (0.01, -0.02, 0.005)), ((0, 0, 0), (0, 0, 0))],
)
def test_normals_under_another_motion_are_those_of_the_same_matches(
    turned: tuple[float, float, float], moved: tuple[float, float, float]
) -> None:
    planes = planes_of(ground()[1])
    other_R, other_T = rotation_from_vector(np.array(turned)) @ R, unit(*(T + np.array(moved)))
    found = normals_under(planes, root_of(), other_R, other_T)
    # matches of the plane, each with the depth that the other motion gives it: a plane through these, by least squares
    for i, j in ((0, 0), (3, 5), (8, 8)):
        centre = planes.middle[i, j, :2] / planes.middle[i, j, 2]
        x1 = homogeneous(centre + 0.03 * np.random.default_rng(1).uniform(-1, 1, (50, 2)))
        moved1 = (x1 - (x1 @ GROUND)[:, None] * T) @ R.T
        x2 = homogeneous(moved1[:, :2] / moved1[:, 2:])
        turned1 = x1 @ other_R.T
        # x2 is along turned1 - w R T, across which the two are compared
        away, line = np.cross(x2, turned1), np.cross(x2, np.broadcast_to(other_R @ other_T, x2.shape))
        w = (away[:, :2] * line[:, :2]).sum(1) / (line[:, :2] ** 2).sum(1)
        direct = np.linalg.lstsq(x1, w, rcond=None)[0]
        assert found[i, j] == pytest.approx(direct, abs=2e-4)


def test_the_same_motion_gives_the_same_normals() -> None:
    planes = planes_of(ground()[1])
    np.testing.assert_allclose(normals_under(planes, root_of(), R, T), planes.scaled_normal, atol=1e-7)


def test_covariance_by_the_motion_is_that_of_drawn_motions() -> None:
    rng = np.random.default_rng(2)
    factor = 3e-4 * rng.standard_normal((5, 5))
    depth = ground()[1]
    planes = planes_of(depth)
    quiet = normal_covariance(planes, root_of(), gradient_parts(depth, planes, no_jump(planes)).total)
    found = (
        normal_covariance(planes, root_of(factor @ factor.T), gradient_parts(depth, planes, no_jump(planes)).total)
        - quiet
    )
    root = root_of()
    drawn = np.array([normals_under(planes, root, *root.moved(factor @ rng.standard_normal(5))) for _ in range(1500)])
    off = drawn - planes.scaled_normal
    for i, j in ((0, 0), (4, 4), (8, 8)):
        direct = off[:, i, j].T @ off[:, i, j] / len(off)
        assert np.abs(found[i, j] - direct).max() < 0.12 * np.abs(direct).max()


def test_covariance_by_the_focal_length_is_the_change_that_goes_with_it() -> None:
    depth = ground()[1]
    planes = planes_of(depth)
    sigma = 0.01
    root = replace(root_of(focal_sigma=sigma), focal_motion=np.array([1e-3, -2e-3, 0.0, 3e-3, 1e-3]))
    found = normal_covariance(planes, root, gradient_parts(depth, planes, no_jump(planes)).total)
    found = found - normal_covariance(planes, root_of(), gradient_parts(depth, planes, no_jump(planes)).total)
    changed = normals_under(planes, root, *root.moved(root.focal_motion), zoom=float(np.exp(-sigma)))
    shift = changed - planes.scaled_normal
    direct = shift[..., :, None] * shift[..., None, :]
    assert np.abs(found - direct).max() < 0.05 * np.abs(direct).max()


@pytest.mark.parametrize("k1", [-0.3, 0.2])
def test_a_lens_bends_the_rays_of_another_focal_length_by_another_share(k1: float) -> None:
    planes, px, sigma = planes_of(ground()[1]), 400.0, 0.01
    camera = Camera(640, 480, px, px, 320.0, 240.0, "brown", (k1, 0.05, 0.0, 0.0, 0.0))
    longer = replace(camera, fx=px * np.exp(sigma), fy=px * np.exp(sigma))
    root = replace(root_of(focal_sigma=sigma), cameras=(camera, camera))
    changed = normals_under(planes, root, R, T, zoom=float(np.exp(-sigma)))
    for i, j in ((0, 0), (4, 4), (8, 8)):
        # rays to the plane about the footprint, and where image 2 shows them, as the longer focal length sees both
        x1 = planes.middle[i, j, :2] / planes.middle[i, j, 2] + 0.02 * np.random.default_rng(3).standard_normal((50, 2))
        w = homogeneous(x1) @ planes.scaled_normal[i, j]
        moved = homogeneous(x1) @ R.T - w[:, None] * (R @ T)
        seen1, seen2 = (
            rays_from_pixels(longer, pixels_from_rays(camera, x)) for x in (x1, moved[:, :2] / moved[:, 2:])
        )
        direct = np.linalg.lstsq(homogeneous(seen1), inverse_depth(R, T, seen1, seen2)[0], rcond=None)[0]
        np.testing.assert_allclose(
            changed[i, j] - direct, 0.0, atol=0.05 * np.abs(direct - planes.scaled_normal[i, j]).max()
        )


# ---- by noise ----


def noise(seed: int, sigma: float, shape: tuple[int, int], correlation_px: float = 2.5) -> FloatArray:
    """Correlated noise of this 1-sigma, px."""
    white = np.random.default_rng(seed).standard_normal(shape).astype(np.float32)
    smooth = cv2.GaussianBlur(white, (0, 0), correlation_px, borderType=cv2.BORDER_REFLECT)
    return np.asarray(sigma * smooth / smooth.std())


def test_tilts_by_correlated_noise_are_as_large_as_what_is_left_tells() -> None:
    """The margin is for the finite number of footprints: some twenty that do not overlap, in a dozen draws."""
    depth, sigma = ground()[1], 0.05
    off, told = [], []
    for seed in range(12):
        along, across, left = (noise(3 * seed + k, sigma, depth.w.shape).astype(np.float32) for k in range(3))
        noisy = replace(depth, w=depth.w * np.exp(along / depth.shift_px), across_px=across, along_px=left)
        planes = planes_of(noisy)
        covariance = normal_covariance(planes, root_of(), gradient_parts(noisy, planes, no_jump(planes)).total)
        error = planes.scaled_normal - GROUND
        length = np.linalg.norm(GROUND)
        axes = tangent_basis(GROUND / length).T
        off.append([(error @ axis / length) ** 2 for axis in axes])
        told.append([np.einsum("i,...ij,j->...", axis, covariance, axis) / length**2 for axis in axes])
    ratio = np.sqrt(np.mean(told) / np.mean(off))
    assert 0.65 < ratio < 1.25


def test_sigma_by_noise_is_proportional_to_it_and_falls_with_the_square_of_the_diameter() -> None:
    depth = ground()[1]

    def sigma_of(noise_px: float, radius_px: float) -> float:
        across, left = (noise(seed, noise_px, depth.w.shape).astype(np.float32) for seed in (7, 8))
        noisy = replace(depth, across_px=across, along_px=left)
        planes = planes_of(noisy, replace(CELLS, radius_px=radius_px))
        covariance = normal_covariance(planes, root_of(), gradient_parts(noisy, planes, no_jump(planes)).total)
        return float(np.sqrt(np.median(covariance[..., 0, 0])))

    assert sigma_of(0.2, 16.0) / sigma_of(0.05, 16.0) == pytest.approx(4.0, rel=0.1)
    assert sigma_of(0.1, 10.0) / sigma_of(0.1, 20.0) == pytest.approx(4.0, rel=0.35)


def test_ground_that_is_partly_unmatched_is_in_more_doubt_the_rougher_it_is() -> None:
    depth = ground()[1]
    holes = depth.known.copy()
    holes[::5, ::5] = False
    sizes = []
    for relief, sure in ((0.0, depth.known), (0.0, holes), (0.02, holes)):
        rough = replace(depth, w=depth.w * np.exp(noise(9, relief, depth.w.shape, 1.0)), sure=sure)
        planes = planes_of(rough)
        covariance = normal_covariance(planes, root_of(), gradient_parts(rough, planes, no_jump(planes)).total)
        sizes.append(float(np.median(np.trace(covariance, axis1=-2, axis2=-1))))
    assert sizes[0] <= sizes[1] < 0.2 * sizes[2]


def test_ground_that_is_unmatched_tilts_the_more_the_more_of_it_lies_to_one_side() -> None:
    depth = ground()[1]
    rough = replace(depth, w=depth.w * np.exp(noise(9, 0.02, depth.w.shape, 1.0)), sure=np.ones_like(depth.sure))
    cells = Cells(np.array([160]), np.array([120]), 20.0)
    beside, across = np.arange(320) - 160, np.arange(240)[:, None] - 120
    parts = (np.abs(beside) > 14) & (across < 999), (beside > 11) & (across < 999), np.hypot(beside, across) < 9
    both, right, middle = (
        float(gradient_parts(replace(rough, sure=~part), planes, no_jump(planes)).total[0, 0, 0, 0])
        for part in parts
        for planes in [planes_of(replace(rough, sure=~part), cells)]
    )
    least = float(gradient_parts(rough, planes_of(rough, cells), no_jump(planes_of(rough, cells))).total[0, 0, 0, 0])
    assert both == pytest.approx(least, rel=0.05)
    assert middle == pytest.approx(least, rel=0.05)
    assert right > 2.5 * least


# ---- steps ----


@pytest.mark.parametrize("direction", [(0, 1, 0), (-1, 0, 0)])
def test_a_step_is_told_from_a_slope_and_from_level_ground_whatever_its_direction(
    direction: tuple[float, float, float],
) -> None:
    level, drop = tilted(0, 0, 6.0), Surface(tilted(0, 0, 7.0), (200, 0, 120, 240))
    for surfaces, steps in (([level, drop], True), ([tilted(0.7, 0.0, 6.0)], False), ([level], False)):
        pair = render(turn(), unit(*direction), surfaces)
        depth = measure_depth(scene_of(pair))
        planes = planes_of(depth)
        found = across_step(depth, planes, largest_jump(depth, planes))
        on_edge = np.abs(CELLS.u - 199.5) < 10
        inside = (CELLS.v > 80) & (CELLS.v < 190)  # image 2 shows it
        assert found[np.ix_(inside, on_edge)].mean() == pytest.approx(1.0 if steps else 0.0, abs=0.1)
        assert not found[np.ix_(inside, np.abs(CELLS.u - 199.5) > 22)].any()


def test_a_step_that_makes_little_displacement_is_told_by_its_height() -> None:
    level, drop = tilted(0, 0, 6.0), Surface(tilted(0, 0, 7.0), (200, 0, 120, 240))
    pair = render(turn(), unit(0, 1, 0), [level, drop])
    depth = true_depth(measure_depth(scene_of(pair)), pair)
    assert not depth.step.any()  # as if the cameras had hardly moved
    planes = planes_of(depth)
    found = across_step(depth, planes, largest_jump(depth, planes))
    assert found[:, np.abs(CELLS.u - 199.5) < 10].all()
    assert not found[:, np.abs(CELLS.u - 199.5) > 22].any()


def test_ground_is_wholly_shown_if_no_footprint_reaches_to_what_is_not() -> None:
    shown = np.ones((240, 320), bool)
    shown[:, 200:] = False
    told = wholly_shown(shown, CELLS)
    reach = CELLS.radius_px + 4  # as far as a border misleads matching
    inside = (CELLS.u > reach) & (CELLS.u < 199 - reach)
    rows = (CELLS.v > reach) & (CELLS.v < 239 - reach)
    assert told[np.ix_(rows, inside)].all()
    assert not told[:, CELLS.u > 199 - 0.7 * CELLS.radius_px].any()
