"""When a pair cannot tell, or tells little: tests of the images and their matches, before any plane is solved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.geometry.epipolar import fit_rotation, homogeneous
from slopecli.geometry.lens_misfit import LensMisfit
from slopecli.geometry.statistics import median
from slopecli.types import Camera, Diagnostic, FloatArray, Image

MIN_INLIERS = 20  # matches consistent with one motion below which chance explains them
MIN_SHARE = 0.12  # of the tentative matches
FEW_FEATURES = 60  # tentative features in an image with hardly any texture
STRANGE_SHARE, UNEXPLAINED_SHARE = 0.15, 0.5  # of the dense matches: said, and refused, when they defy the motion
LOW_PARALLAX_PX = 3.0  # median parallax below which slopes are governed by matching noise
DISTORTED_PX = 1.0  # at the corner: a lens this close to its model is not worth a word
REMOVED = 0.4  # share of its k1 that a lens may still have, to be called free of distortion
NEAR_M = 20.0  # distance that lengths are given for, as an example
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


def image_notes(image1: Image, image2: Image) -> list[Diagnostic]:
    """What was done, or on purpose not done, in reading the images: rotation marks left alone, 16 bits mapped to 8."""
    noted = [(number, image.note) for number, image in ((1, image1), (2, image2)) if image.note]
    return [Diagnostic("image-note", "info", f"image {number}: {note}", float(number)) for number, note in noted]


def refuse_unmatched(n_features: tuple[int, int], n_matches: int, n_inliers: int) -> None:
    """Raise NoAnswer when too few matches agree on one motion to be more than chance."""
    if min(n_features) < FEW_FEATURES:
        which, few = 1 + int(np.argmin(n_features)), min(n_features)
        raise NoAnswer(
            "low-texture",
            f"image {which} has only {few} distinctive point{'' if few == 1 else 's'}, {FEW_FEATURES} are needed",
            "use sharper, larger, better exposed or closer images",
            value=float(few),
        )
    if n_inliers < MIN_INLIERS or n_inliers < MIN_SHARE * n_matches:
        raise NoAnswer(
            "no-overlap",
            f"of {n_matches} tentative matches only {n_inliers} agree on one motion (at least {MIN_INLIERS} needed)",
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


@dataclass(frozen=True)
class Apart:
    """How far apart the images were taken: `share` of the distance to the scene, and in metres where that is known."""

    share: float
    length_m: float | None = None

    @property
    def sideways(self) -> str:
        """What to do where the move went straight ahead: as far to the side."""
        if self.length_m is not None:
            return f"move {self.length_m:.2g} m sideways as well"
        example = f"{NEAR_M * self.share:.2g} m at {NEAR_M:g} m height"
        return f"move sideways as well, by {100 * self.share:.2g} % of the distance: {example}"

    def farther(self, factor: float) -> str:
        """What to do for so many times the parallax."""
        if self.length_m is not None:
            return f"move {factor * self.length_m:.2g} m between the images instead of {self.length_m:.2g} m"
        wanted, now = factor * self.share, 100 * self.share
        example = f"{NEAR_M * wanted:.2g} m at {NEAR_M:g} m height"
        return (
            f"move by {100 * wanted:.2g} % of the distance to the scene (now {now:.2g} %) between the images: {example}"
        )


def check_parallax(parallax: FloatArray, noise_px: float, apart: Apart | None = None) -> list[Diagnostic]:
    """Raise NoAnswer for a pure rotation; warn when the parallax is small.

    noise_px : 1-sigma of the matches across their epipolar lines.  apart : for a remedy in more than a factor.
    """
    typical, largest = median(parallax), float(np.quantile(parallax, 0.98))
    if largest < ROTATION_SIGMAS * max(4 * noise_px, 0.1):
        raise NoAnswer(
            "pure-rotation",
            f"a rotation of the camera explains all matches to {largest:.2f} px, so there is no parallax",
            "move the camera between the images, by 5 to 20 % of the distance to the scene",
            value=largest,
        )
    if typical >= LOW_PARALLAX_PX:
        return []
    factor = max(LOW_PARALLAX_PX / max(typical, 1e-3), 1.5)
    remedy = f"move {factor:.1f} times as far between the images" if apart is None else apart.farther(factor)
    message = f"median parallax {typical:.1f} px; slopes need about {LOW_PARALLAX_PX:.0f} px"
    return [Diagnostic("low-parallax", "warning", message, typical, remedy)]


def refuse_mirrored(x1: FloatArray, x2: FloatArray) -> None:
    """Raise NoAnswer when image 2 shows the scene with left and right exchanged: no camera motion does that."""
    design = homogeneous(x1)
    linear = np.linalg.lstsq(design, x2, rcond=None)[0][:2]
    turn = float(np.linalg.det(linear))
    if turn < 0:
        raise NoAnswer("poor-fit", "image 2 is mirrored", "flip it back, left to right or top to bottom", value=turn)


def check_strangers(n_matches: int, n_obeying: int) -> list[Diagnostic]:
    """Raise NoAnswer when most dense matches contradict the motion; warn when many do.

    n_matches : dense matches that close forwards and backwards; n_obeying : those near their epipolar lines.
    """
    share = 1 - n_obeying / max(n_matches, 1)
    if share > UNEXPLAINED_SHARE:
        raise NoAnswer(
            "no-overlap",
            f"the best camera motion contradicts {100 * share:.0f} % of the dense matches",
            "give two images of the same ground, neither mirrored, and the camera they were taken with",
            value=share,
        )
    if share < STRANGE_SHARE:
        return []
    return [
        Diagnostic(
            "dense-shadow-or-motion",
            "warning",
            f"{100 * share:.0f} % of the dense matches move otherwise than the scene: shadows, vehicles or mismatches",
            share,
            "distrust windows where something moved; take both images in quick succession",
        )
    ]


def check_lens(misfit: LensMisfit | None, camera: Camera) -> list[Diagnostic]:
    """Warn when the matches ask for another lens distortion than the camera file has.

    misfit : what they ask for, where they do so clearly.  camera : of image 1; the lens of both is taken as alike.
    """
    if misfit is None:
        return []
    corner_px = abs(misfit.term) * _corner_radius(camera) ** 3 * camera.focal_px
    if corner_px < DISTORTED_PX:
        return []
    given = camera.distortion[0] if camera.distortion else 0.0
    removed = abs(given) > 0.0 and abs(given - misfit.term) < REMOVED * abs(given)
    own = "besides that of the camera file" if camera.distortion else "which the camera file does not have,"
    return [
        Diagnostic(
            "suspect-distortion",
            "warning",
            "residuals grow with the distance from the image centre as a lens distortion of k1 = "
            f"{-misfit.term:.2g} {own} would make them ({corner_px:.1f} px at the corner)",
            corner_px,
            "leave the distortion out of the camera file: it seems to be taken out of the images already"
            if removed
            else "calibrate the lens, and give its distortion in the camera file",
        )
    ]


def _corner_radius(camera: Camera) -> float:
    """Normalised distance of the farthest corner from the principal point, before distortion."""
    x = max(camera.cx, camera.width - 1 - camera.cx) / camera.fx
    y = max(camera.cy, camera.height - 1 - camera.cy) / camera.fy
    return float(np.hypot(x, y))
