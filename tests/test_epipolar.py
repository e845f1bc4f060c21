"""Epipolar geometry: definitions hold on points with known motion."""

from __future__ import annotations

import numpy as np
import pytest

from slopecli.geometry import direction_angle, epipolar, rotation_angle
from slopecli.study import Scene, make_scene


@pytest.fixture
def scene() -> Scene:
    return make_scene(np.random.default_rng(5), free_points=50, noise_px=0.0)


def test_essential_matrix_vanishes_on_true_points(scene: Scene) -> None:
    E = epipolar.essential_matrix(scene.R, scene.T)
    assert np.abs(epipolar.epipolar_distance(E, scene.x1, scene.x2)).max() < 1e-15


def test_epipolar_distance_is_the_distance_to_the_line(scene: Scene) -> None:
    E = epipolar.essential_matrix(scene.R, scene.T)
    lines = epipolar.homogeneous(scene.x1) @ E.T
    unit = lines[:, :2] / np.linalg.norm(lines[:, :2], axis=1, keepdims=True)
    moved = scene.x2 + 0.01 * unit + 0.5 * unit[:, ::-1] * [1.0, -1.0]
    assert epipolar.epipolar_distance(-3.0 * E, scene.x1, moved) == pytest.approx(-0.01 * np.ones(len(moved)))


def test_decomposition_of_the_essential_matrix_holds_the_motion(scene: Scene) -> None:
    R, T = epipolar.decompose_essential(-2.0 * epipolar.essential_matrix(scene.R, scene.T))
    assert rotation_angle(R, scene.R).min() < 1e-14
    assert min(direction_angle(T, scene.T), direction_angle(-T, scene.T)) < 1e-14
    assert np.linalg.det(R) == pytest.approx([1.0, 1.0])


def test_focus_of_expansion_does_not_move_without_rotation() -> None:
    assert epipolar.focus_of_expansion(np.array([0.1, 0.2, -1.0])) == pytest.approx([-0.1, -0.2])
    assert epipolar.focus_of_expansion(np.array([1.0, 0.0, 0.0])) is None


@pytest.mark.parametrize("v", [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.6, 0.0, -0.8], [1.0, 0.0, 0.0]])
def test_tangent_basis_is_orthonormal(v: list[float]) -> None:
    basis = np.column_stack([epipolar.tangent_basis(np.array(v)), v])
    assert basis.T @ basis == pytest.approx(np.eye(3), abs=1e-15)


def test_fitted_rotation_is_exact_for_a_pure_rotation() -> None:
    rng = np.random.default_rng(1)
    R = epipolar.rotation_from_vector(np.array([0.2, -0.1, 0.4]))
    p = epipolar.homogeneous(rng.uniform(-0.5, 0.5, (20, 2))).T
    y = R @ p
    assert rotation_angle(epipolar.fit_rotation(p, y[:2] / y[2], np.ones(20)), R) < 1e-15
