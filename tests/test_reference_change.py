"""Planes that a later reference shows, joined with what the first one tells: surer, and no surer than they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaign import seeds
from view_scenes import FOCAL_PX, Views, views

from slopecli.geometry import ViewsSolution, homogeneous, normal_angle, rotation_from_vector, solve_views
from slopecli.geometry.solver import LaterViews, last_view, with_later_views
from slopecli.types import FloatArray, IntArray

NOISE = 0.3 / FOCAL_PX


def from_the_last(scene: Views, seed: int, planes: IntArray, steps: FloatArray) -> ViewsSolution:
    """Solution of views taken from the last view of a scene at these steps (k, 3), of some of its planes."""
    rng = np.random.default_rng([seed, 77])
    R, T = scene.R[-1], scene.T[-1]
    own = scene.normals[planes] @ R.T / (1.0 - scene.normals[planes] @ T)[:, None]
    shown = np.flatnonzero(np.isin(scene.patch, planes))
    patch = np.searchsorted(planes, scene.patch[shown])
    u = (scene.normals[scene.patch[shown]] * homogeneous(scene.x1[shown])).sum(axis=1)
    P = R @ (homogeneous(scene.x1[shown]).T / u - T[:, None])
    p = P / P[2]
    turns = rotation_from_vector(np.radians(3.0) * rng.standard_normal((len(steps), 3)))
    y = turns @ p - (turns @ steps[:, :, None]) * (own[patch].T * p).sum(axis=0)
    x = (y[:, :2] / y[:, 2:]).transpose(0, 2, 1)
    return solve_views(p[:2].T, x + NOISE * rng.standard_normal(x.shape), patch)


def chi2(solution: ViewsSolution, truth: FloatArray) -> FloatArray:
    """(m,) squared error of each unit normal over its covariance."""
    length = np.linalg.norm(solution.scaled_normals, axis=1)
    n, true = solution.scaled_normals / length[:, None], truth / np.linalg.norm(truth, axis=1, keepdims=True)
    across = np.eye(3) - n[:, :, None] * n[:, None]
    spread = across @ solution.normal_covariance @ across / length[:, None, None] ** 2
    return np.einsum("ma,mab,mb->m", n - true, np.linalg.pinv(spread, rcond=1e-9, hermitian=True), n - true)


STEPS = np.array([[0.3, 0.5, 1.2], [0.5, 1.2, 2.4]])
CARRIED = np.array([1, 4, 5])


def joined(seed: int, tilt: float = 0.0) -> tuple[Views, ViewsSolution, ViewsSolution]:
    """A scene, what its views tell, and that with views of three of its planes from the last one."""
    scene = views(seed, 3, 45.0)
    before = solve_views(scene.x1, scene.x, scene.patch)
    later = from_the_last(scene, seed, CARRIED, STEPS)
    unit = float(np.linalg.norm(STEPS[0]))
    told = LaterViews(later, CARRIED, unit, tilt**2 * np.repeat(np.eye(3)[None], len(CARRIED), axis=0))
    return scene, before, with_later_views(last_view(before), told)


def test_the_last_view_alone_is_the_pair_that_it_was() -> None:
    scene = views(3, 3, 45.0)
    whole = solve_views(scene.x1, scene.x, scene.patch)
    pair, alone = whole.pair(), last_view(whole).pair(0)
    np.testing.assert_allclose(alone.scaled_normals, pair.scaled_normals)
    np.testing.assert_allclose(alone.normal_covariance, pair.normal_covariance, rtol=1e-6)
    np.testing.assert_allclose(alone.motion_covariance, pair.motion_covariance, rtol=1e-6)


def test_later_views_sharpen_their_planes_and_sigmas_hold() -> None:
    errors, squares, falls, trials = [], [], [], seeds(200, 6)
    for seed in trials:
        scene, before, after = joined(seed)
        squares.append(chi2(after, scene.normals))
        errors.append([normal_angle(one.scaled_normals[CARRIED], scene.normals[CARRIED]) for one in (before, after)])
        falls.append(
            np.trace(after.normal_covariance[CARRIED], axis1=1, axis2=2)
            / np.trace(before.normal_covariance[CARRIED], axis1=1, axis2=2)
        )
    rms = np.sqrt(np.mean(np.square(errors), axis=(0, 2)))
    assert rms[1] < rms[0]
    assert np.max(falls) < 1.0
    covered = np.mean(np.array(squares) < 5.99)
    assert covered > 0.85
    if len(trials) > 100:
        assert 0.93 < covered < 0.97


def test_the_new_last_view_is_where_it_was_taken() -> None:
    scene, _, after = joined(2)
    true = scene.T[-1] + scene.R[-1].T @ STEPS[-1]
    np.testing.assert_allclose(after.T[1], true, atol=0.03 * np.linalg.norm(true))
    np.testing.assert_allclose(after.R[0], scene.R[-1], atol=0.01)


def test_a_plane_of_other_ground_is_not_taken() -> None:
    scene = views(1, 3, 45.0)
    known = last_view(solve_views(scene.x1, scene.x, scene.patch))
    later = from_the_last(scene, 1, CARRIED, STEPS)
    unit = float(np.linalg.norm(STEPS[0]))
    right = with_later_views(known, LaterViews(later, CARRIED, unit, np.zeros((3, 3, 3))))
    wrong = with_later_views(known, LaterViews(later, np.array([1, 8, 5]), unit, np.zeros((3, 3, 3))))
    assert np.degrees(normal_angle(wrong.scaled_normals, known.scaled_normals)).max() < 0.5
    assert np.degrees(normal_angle(right.scaled_normals, scene.normals)).max() < 1.0


def test_doubt_of_a_plane_is_heeded() -> None:
    """A plane of a small part of a window tells little of the whole of it."""
    _, before, sure = joined(4)
    doubtful = joined(4, tilt=1.0)[2]
    sizes = [np.trace(one.normal_covariance[CARRIED], axis1=1, axis2=2) for one in (sure, doubtful, before)]
    assert (sizes[0] < sizes[1]).all()
    np.testing.assert_allclose(sizes[1], sizes[2], rtol=0.2)


@pytest.mark.parametrize("order", [[2, 0, 1], [1, 2, 0]])
def test_the_order_of_planes_does_not_matter(order: list[int]) -> None:
    scene, _, straight = joined(5)
    known = last_view(solve_views(scene.x1, scene.x, scene.patch))
    later = from_the_last(scene, 5, CARRIED, STEPS)
    own = later.normal_gain[order], later.own_covariance[order], later.scaled_normals[order]
    turned = replace(later, normal_gain=own[0], own_covariance=own[1], scaled_normals=own[2])
    unit = float(np.linalg.norm(STEPS[0]))
    again = with_later_views(known, LaterViews(turned, CARRIED[order], unit, np.zeros((3, 3, 3))))
    np.testing.assert_allclose(again.scaled_normals, straight.scaled_normals, atol=1e-9)
