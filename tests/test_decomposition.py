"""Longuet-Higgins decomposition, Cheng eqs. (6)-(8)."""

from __future__ import annotations

import numpy as np
import pytest

from slopecli.errors import DegenerateConfiguration, InputError
from slopecli.geometry import (
    PlaneMotion,
    decompose_homography,
    homogeneous,
    homography_of_plane,
    longuet_higgins,
    rotation_from_vector,
)

EXACT = 1e-9
R = rotation_from_vector(np.array([0.05, -0.1, 0.3]))
CASES = {
    "general": (np.array([0.6, 0.0, 0.8]), np.array([0.02, -0.05, 0.2])),
    "level flight": (np.array([1.0, 0.0, 0.0]), np.array([0.05, 0.03, 0.2])),
    "descent, tilted ground": (np.array([0.0, 0.0, 1.0]), np.array([0.05, 0.0, 0.2])),
    "descent, level ground": (np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 0.2])),
    "ascent, level ground": (np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 0.2])),
    "along a tilted normal": (np.array([0.0, 0.6, 0.8]), 0.2 * np.array([0.0, 0.6, 0.8])),
    "close approach": (np.array([0.1, 0.0, 0.99]) / np.hypot(0.1, 0.99), np.array([0.1, 0.1, 0.9])),
}
POINTS = np.random.default_rng(0).uniform(-0.5, 0.5, (30, 2))


def distance(candidate: PlaneMotion, T: np.ndarray, N: np.ndarray) -> float:
    parts = (candidate.R - R, candidate.T - T, candidate.N - N)
    return max(float(np.abs(part).max()) for part in parts)


@pytest.mark.parametrize("scale", [1.0, -1.0, 1e-3, -250.0])
@pytest.mark.parametrize("name", CASES)
def test_truth_is_among_the_candidates(name: str, scale: float) -> None:
    T, N = CASES[name]
    H = scale * homography_of_plane(R, T, N)
    assert min(distance(c, T, N) for c in decompose_homography(H)) < EXACT
    assert min(distance(c, T, N) for c in decompose_homography(H, POINTS)) < EXACT


@pytest.mark.parametrize("name", CASES)
def test_every_candidate_explains_the_homography(name: str) -> None:
    T, N = CASES[name]
    H = homography_of_plane(R, T, N)
    for c in decompose_homography(H):
        again = homography_of_plane(c.R, c.T, c.N)
        assert np.abs(again - H).max() < EXACT
        assert abs(np.linalg.norm(c.T) - 1.0) < 1e-12
        assert np.abs(c.R.T @ c.R - np.eye(3)).max() < EXACT
        assert np.linalg.det(c.R) > 0.0


def test_visible_candidates_have_the_plane_in_front_of_both_cameras() -> None:
    T, N = CASES["general"]
    for c in decompose_homography(homography_of_plane(R, T, N), POINTS):
        inverse_depth = homogeneous(POINTS) @ c.N
        assert (inverse_depth > 0.0).all()
        assert ((homogeneous(POINTS) - inverse_depth[:, None] * c.T) @ c.R[2] > 0.0).all()


def test_visibility_asks_every_point_not_only_the_third_component() -> None:
    """A plane with n3 > 0 can still lie behind the camera at the edge of a wide patch."""
    T, N = np.array([0.8, 0.0, 0.6]), np.array([0.3, 0.0, 0.1])
    near, wide = np.array([[0.0, 0.0], [0.1, 0.1], [0.1, -0.1]]), np.array([[-0.5, 0.0], [0.1, 0.1], [0.1, -0.1]])
    H = homography_of_plane(R, T, N)
    assert min(distance(c, T, N) for c in decompose_homography(H, near)) < EXACT
    with_edge = decompose_homography(H)
    assert any(c.N[2] > 0.0 and not (homogeneous(wide) @ c.N > 0.0).all() for c in with_edge)


def test_middle_singular_value_sets_the_scale() -> None:
    """Eqs. (6)-(7) need W scaled so that its middle eigenvalue is 1; the text omits it."""
    T, N = CASES["general"]
    assert np.linalg.svd(homography_of_plane(R, T, N), compute_uv=False)[1] == pytest.approx(1.0, abs=1e-14)


def test_vertical_descent_has_singular_values_one_one_and_four_fifths() -> None:
    T, N = CASES["descent, level ground"]
    assert np.linalg.svd(homography_of_plane(R, T, N), compute_uv=False) == pytest.approx([1.0, 1.0, 0.8])


def test_norm_of_equation_8_is_spectral() -> None:
    """The Frobenius norm would give R / sqrt(3)."""
    T, N = CASES["general"]
    H = 5.0 * homography_of_plane(R, T, N)
    M = H @ np.linalg.inv(np.eye(3) - np.outer(T, N))
    assert M / np.linalg.norm(M, 2) == pytest.approx(R, abs=1e-14)
    assert M / np.linalg.norm(M) == pytest.approx(R / np.sqrt(3.0), abs=1e-14)


def test_batch_agrees_with_one_at_a_time() -> None:
    H = np.stack([homography_of_plane(R, T, N) for T, N in CASES.values()])
    rotations, directions, normals = longuet_higgins(H)
    for i in range(len(H)):
        one = longuet_higgins(H[i : i + 1])
        assert np.array_equal(rotations[i], one[0][0])
        assert np.array_equal(directions[i], one[1][0])
        assert np.array_equal(normals[i], one[2][0])


def test_rotation_is_refused() -> None:
    with pytest.raises(DegenerateConfiguration, match="pure rotation"):
        decompose_homography(3.0 * R)


@pytest.mark.parametrize("smallest", [0.0, 1e-16, 1e-10, 5e-8])
def test_singular_matrix_is_refused(smallest: float) -> None:
    """Also what is not quite singular: of its square only rounding is left, and that may be negative."""
    turn = rotation_from_vector(np.array([0.3, -0.5, 0.2]))
    with pytest.raises(DegenerateConfiguration, match="singular"):
        decompose_homography(turn @ np.diag([1.0, 0.3, smallest]) @ turn)


@pytest.mark.parametrize("H", [np.eye(2), np.full((3, 3), np.nan)])
def test_not_a_homography_is_refused(H: np.ndarray) -> None:
    with pytest.raises(InputError, match="finite 3x3"):
        decompose_homography(H)
