"""Homographies: exact on exact points, least squares on noisy ones, one clear sentence on hopeless ones."""

from __future__ import annotations

import numpy as np
import pytest
from campaign import seeds

from slopecli.errors import DegenerateConfiguration, InputError
from slopecli.geometry import (
    apply_homography,
    fit_homography,
    four_point_homographies,
    homography_in_pixels,
    homography_of_plane,
)
from slopecli.study import make_scene


def true_homography(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    scene = make_scene(np.random.default_rng(seed), grid=(1, 1), points=60, max_slope_deg=20.0)
    return homography_of_plane(scene.R, scene.T, scene.normals[0]), scene.x1_clean, scene.x2_clean, scene.noise


def test_plane_homography_maps_its_points() -> None:
    H, x1, x2, _ = true_homography(1)
    assert apply_homography(H, x1) == pytest.approx(x2, abs=1e-15)


def test_fit_is_exact_without_noise_in_any_unit() -> None:
    H, x1, x2, _ = true_homography(2)
    fitted = fit_homography(x1, x2)
    assert apply_homography(fitted, x1) == pytest.approx(x2, abs=1e-13)
    assert fitted / fitted[2, 2] == pytest.approx(H / H[2, 2], abs=1e-12)
    pixels = fit_homography(900.0 * x1 + 511.5, 900.0 * x2 + 511.5)
    K = np.array([[900.0, 0.0, 511.5], [0.0, 900.0, 511.5], [0.0, 0.0, 1.0]])
    assert pixels / pixels[2, 2] == pytest.approx(homography_in_pixels(H, K, K), rel=1e-9, abs=1e-9)


def test_fit_minimises_the_residuals_in_image_2() -> None:
    """No nearby homography has a smaller sum of squares: the gradient vanishes at the answer."""
    _, x1, x2, noise = true_homography(3)
    found = x2 + noise * np.random.default_rng(0).standard_normal(x2.shape)
    H = fit_homography(x1, found)

    def cost(h: np.ndarray) -> float:
        return float(((apply_homography(h.reshape(3, 3), x1) - found) ** 2).sum())

    step = 1e-6
    gradient = [(cost(H.ravel() + step * e) - cost(H.ravel() - step * e)) / (2 * step) for e in np.eye(9)]
    # one standard error of any entry changes the cost by noise^2 and costs a gradient far above this
    assert np.abs(gradient).max() < 1e-6 * cost(H.ravel()) / noise


def test_weights_of_zero_leave_points_out() -> None:
    _, x1, x2, _ = true_homography(4)
    x2 = x2.copy()
    x2[:5] += 0.3
    weights = np.r_[np.zeros(5), np.ones(len(x1) - 5)]
    assert apply_homography(fit_homography(x1, x2, weights), x1[5:]) == pytest.approx(x2[5:], abs=1e-12)


@pytest.mark.parametrize(
    ("x1", "message"),
    [
        (np.zeros((3, 2)), "at least 4"),
        (np.zeros((5, 2)), "coincide"),
        (np.column_stack([np.arange(6.0), 2.0 * np.arange(6.0)]), "collinear"),
    ],
)
def test_degenerate_points_are_named(x1: np.ndarray, message: str) -> None:
    with pytest.raises(DegenerateConfiguration, match=message):
        fit_homography(x1, x1 + 0.1)


def test_wrong_shapes_are_named() -> None:
    with pytest.raises(InputError, match="same shape"):
        fit_homography(np.zeros((5, 2)), np.zeros((4, 2)))


def test_samples_of_few_distinct_numbers_give_finite_matrices() -> None:
    """Coordinates that repeat make systems of which the small ridge can cancel a pivot."""
    rng, numbers = np.random.default_rng(0), np.array([0.0, 1.0, 2.0, 500.0])
    for _ in range(5):
        x1, x2 = rng.choice(numbers, (2, 2000, 4, 2))
        assert np.isfinite(four_point_homographies(x1, x2)).all()


def test_points_of_few_distinct_numbers_have_a_homography_or_a_reason() -> None:
    """Repeated coordinates leave normal equations that rounding makes singular."""
    numbers, reasons = np.array([0.0, 1.0, 2.0, 500.0]) / 700.0, set()
    for seed in seeds(800, 200):
        x1, x2 = np.random.default_rng(seed).choice(numbers, (2, 8, 2))
        try:
            assert np.isfinite(fit_homography(x1, x2)).all()
        except DegenerateConfiguration as error:
            reasons.add(str(error))
    assert all("fix no homography" in reason for reason in reasons)


def test_four_points_fix_a_homography_each_sample_its_own() -> None:
    (H, x1, x2, _), (other, y1, y2, _) = true_homography(4), true_homography(5)
    found = four_point_homographies(np.stack([x1[:4], y1[10:14]]), np.stack([x2[:4], y2[10:14]]))
    assert found == pytest.approx(np.stack([H / H[2, 2], other / other[2, 2]]), abs=1e-8)


def test_collinear_samples_do_not_stop_the_others() -> None:
    H, x1, x2, _ = true_homography(6)
    samples1, samples2 = (
        np.stack([np.repeat(x1[:1], 4, axis=0), x1[:4]]),
        np.stack([np.repeat(x2[:1], 4, axis=0), x2[:4]]),
    )
    found = four_point_homographies(samples1, samples2)
    assert np.isfinite(found).all()
    assert found[1] == pytest.approx(H / H[2, 2], abs=1e-8)
