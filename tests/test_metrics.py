"""Angles hold their digits where the arc cosine loses them."""

from __future__ import annotations

import numpy as np
import pytest

from slopecli.geometry import direction_angle, normal_angle, rotation_angle, rotation_from_vector, rotation_vector

AXIS = np.array([0.36, -0.48, 0.8])


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.3, np.pi / 2, 3.0, np.pi - 1e-6, np.pi])
def test_rotation_angle_is_exact_from_zero_to_pi(angle: float) -> None:
    R = rotation_from_vector(angle * AXIS)
    assert float(rotation_angle(R)) == pytest.approx(angle, abs=1e-15, rel=1e-9)


def test_rotation_angle_between_two() -> None:
    a, b = rotation_from_vector(np.array([0.1, 0.2, 0.3])), rotation_from_vector(0.7 * AXIS)
    assert float(rotation_angle(a, b @ a @ a.T @ a)) == pytest.approx(0.7, rel=1e-12)
    assert float(rotation_angle(a, a)) < 1e-15


@pytest.mark.parametrize("angle", [1e-12, 1e-6, 1.0, np.pi - 1e-6])
def test_direction_angle_is_exact_and_ignores_length(angle: float) -> None:
    a, b = np.array([0.0, 0.0, 3.0]), 0.2 * np.array([np.sin(angle), 0.0, np.cos(angle)])
    assert float(direction_angle(a, b)) == pytest.approx(angle, rel=1e-9)
    assert float(normal_angle(a, b)) == float(direction_angle(a, b))


def test_angles_broadcast_over_rows() -> None:
    assert direction_angle(np.eye(3), np.array([1.0, 0.0, 0.0])).tolist() == [0.0, np.pi / 2, np.pi / 2]
    assert rotation_angle(np.stack([np.eye(3), np.diag([1.0, -1.0, -1.0])])).tolist() == [0.0, np.pi]


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.5, 2.5])
def test_rotation_vector_inverts_the_exponential(angle: float) -> None:
    assert rotation_vector(rotation_from_vector(angle * AXIS)) == pytest.approx(angle * AXIS, abs=1e-14)
