"""When a pair cannot tell, or tells little: the tests, each with its number, its cause and its remedy."""

from __future__ import annotations

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.geometry.epipolar import fit_rotation, homogeneous
from slopecli.types import Diagnostic, FloatArray, Image

MIN_INLIERS = 20  # matches consistent with one motion below which chance explains them
MIN_SHARE = 0.12  # of the tentative matches
FEW_FEATURES = 60  # tentative features in an image with hardly any texture
LOW_PARALLAX_PX = 3.0  # median parallax below which slopes are governed by matching noise
ROTATION_SIGMAS = 2.0  # a rotation that fits this well leaves no parallax to measure


def refuse_identical(image1: Image, image2: Image) -> None:
    """Raise NoAnswer when both images hold the same pixels."""
    if image1.grey.shape == image2.grey.shape and np.array_equal(image1.grey, image2.grey):
        raise NoAnswer(
            "pure-rotation",
            "the two images are identical, so there is no parallax",
            "take the second image from another place, or check that two different files were given",
            value=0.0,
        )


def refuse_unmatched(n_features: tuple[int, int], n_matches: int, n_inliers: int) -> None:
    """Raise NoAnswer when too few matches agree on one motion to be more than chance."""
    if min(n_features) < FEW_FEATURES:
        which = 1 + int(np.argmin(n_features))
        raise NoAnswer(
            "low-texture",
            f"image {which} has only {min(n_features)} distinctive points",
            "use sharper, better exposed or closer images",
            value=float(min(n_features)),
        )
    if n_inliers < MIN_INLIERS or n_inliers < MIN_SHARE * n_matches:
        raise NoAnswer(
            "no-overlap",
            f"of {n_matches} tentative matches only {n_inliers} agree on one camera motion (at least {MIN_INLIERS} needed)",
            "give two images that show the same ground, at most a factor of two apart in scale",
            value=float(n_inliers),
        )


def parallax_px(x1: FloatArray, x2: FloatArray, focal_px: float) -> FloatArray:
    """(n,) what the best rotation leaves of each match's displacement in image 2, px."""
    p, q = homogeneous(x1).T, np.ascontiguousarray(x2.T)
    weight = np.ones(len(x1))
    left = weight
    for _ in range(4):  # again without the few worst: mismatches
        left = _rotation_residual(fit_rotation(p, q, weight), p, q)
        weight = (left <= np.quantile(left, 0.9)).astype(float)
    return left * focal_px


def _rotation_residual(R: FloatArray, p: FloatArray, x2: FloatArray) -> FloatArray:
    y = R @ p
    return np.asarray(np.linalg.norm(y[:2] / y[2] - x2, axis=0))


def check_parallax(parallax: FloatArray, noise_px: float) -> list[Diagnostic]:
    """Raise NoAnswer for a pure rotation; warn when the parallax is small.

    noise_px : 1-sigma of the matches across their epipolar lines.
    """
    typical, largest = float(np.median(parallax)), float(np.quantile(parallax, 0.98))
    if largest < ROTATION_SIGMAS * max(4 * noise_px, 0.1):
        raise NoAnswer(
            "pure-rotation",
            f"a rotation of the camera explains all matches to {largest:.2f} px, so there is no parallax",
            "move the camera between the images, by 5 to 20 % of the distance to the scene",
            value=largest,
        )
    if typical < LOW_PARALLAX_PX:
        return [
            Diagnostic(
                "low-parallax",
                "warning",
                f"median parallax {typical:.1f} px; slopes need about {LOW_PARALLAX_PX:.0f} px",
                typical,
                f"move {max(LOW_PARALLAX_PX / max(typical, 1e-3), 1.5):.1f} times as far between the images",
            )
        ]
    return []
