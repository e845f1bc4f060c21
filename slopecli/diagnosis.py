"""When a pair cannot tell, or tells little: the tests, each with its number, its cause and its remedy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slopecli.errors import NoAnswer
from slopecli.geometry.camera import pixels_from_rays
from slopecli.geometry.epipolar import fit_rotation, focus_of_expansion, homogeneous
from slopecli.types import Camera, Diagnostic, FloatArray, Image, Plane, Solution, Source

MIN_INLIERS = 20  # matches consistent with one motion below which chance explains them
MIN_SHARE = 0.12  # of the tentative matches
FEW_FEATURES = 60  # tentative features in an image with hardly any texture
POOR_FIT_PX = 0.5  # noise of matches beyond which the cameras are in doubt, or the images
STRANGE_SHARE, UNEXPLAINED_SHARE = 0.15, 0.5  # of the dense matches: said, and refused, when they defy the motion
LOW_PARALLAX_PX = 3.0  # median parallax below which slopes are governed by matching noise
NON_PLANAR = "non-planar-patch"  # as a diagnostic, and as the reason of a plane
# what to do about it
FLATTER: dict[Source, str] = {
    "window": "use smaller windows",
    "ransac": "look at it with --window, or lower --merge-px",
    "region": "look at it with --window, or lower --merge-px",
    "given": "leave out rows that lie off it, or give them another patch",
}
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
        which = 1 + int(np.argmin(n_features))
        raise NoAnswer(
            "low-texture",
            f"image {which} has only {min(n_features)} distinctive points, {FEW_FEATURES} are needed",
            "use sharper, larger, better exposed or closer images",
            value=float(min(n_features)),
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


def epipole1_px(solution: Solution, camera1: Camera) -> tuple[float, float] | None:
    """Pixel of image 1 the camera moves towards or away from, None when it is not inside the image."""
    focus = focus_of_expansion(solution.T)
    if focus is None:
        return None
    u, v = pixels_from_rays(camera1, focus[None])[0]
    inside = -0.5 <= u < camera1.width - 0.5 and -0.5 <= v < camera1.height - 0.5  # False for NaN, too
    return (float(u), float(v)) if inside else None


def diagnose(
    planes: tuple[Plane, ...],
    relief: dict[int, float],
    solution: Solution,
    epipole: tuple[float, float] | None,
    noise_px: float,
    labels: NDArray[np.uint16],
) -> list[Diagnostic]:
    """What a user should know of an answer: weak windows, a second motion, a solution that did not settle.

    relief : RMS height off the plane over its distance, by plane id.  epipole : px of image 1, None when outside.
    noise_px : 1-sigma of the median match, as measured.  labels : (h, w) plane id per pixel of image 1, 0 for none.
    """
    found = [_focus_in(plane) for plane in planes if epipole is not None and _holds(plane, epipole, labels)]
    found += [_not_flat(plane, relief[plane.id]) for plane in planes if NON_PLANAR in (plane.reason or "")]
    if solution.ambiguity.status == "unresolved":
        found.append(_second_motion(solution))
    if noise_px > POOR_FIT_PX:
        found.append(_poor_fit(noise_px))
    if not solution.converged:
        remedy = "check the camera file, and that nothing in view moved"
        found.append(Diagnostic("poor-fit", "warning", "the joint solution did not settle", None, remedy))
    return found


def _holds(plane: Plane, point: tuple[float, float], labels: NDArray[np.uint16]) -> bool:
    """Whether a point of image 1 lies in a window, or on a pixel of a plane of any shape."""
    if plane.found:
        column, row = np.floor(np.array(point) + 0.5).astype(int)
        return bool(labels[row, column] == plane.id)
    low, high = plane.polygon_px.min(0), plane.polygon_px.max(0)
    return bool((low < point).all() and (point < high).all())


def _focus_in(plane: Plane) -> Diagnostic:
    return Diagnostic(
        "foe-in-window",
        "info",
        f"the camera moves along a line of sight through {plane.noun} {plane.id}: it shows least parallax there",
        float(plane.id),
        "move sideways as well" + (", or choose another window" if plane.source == "window" else ""),
    )


def _not_flat(plane: Plane, relief: float) -> Diagnostic:
    return Diagnostic(
        NON_PLANAR,
        "warning",
        f"{plane.noun} {plane.id} is not one plane: relief {100 * relief:.1f} % of its distance, or a step in it",
        float(plane.id),
        FLATTER[plane.source],
    )


def _poor_fit(noise_px: float) -> Diagnostic:
    return Diagnostic(
        "poor-fit",
        "warning",
        f"matches miss their epipolar lines by {noise_px:.2f} px, good pairs by less than {POOR_FIT_PX:g} px",
        noise_px,
        "check the camera file and its distortion; blur, a rolling shutter and moving things do the same",
    )


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


def unexplained(labels: NDArray[np.uint16]) -> Diagnostic:
    """The share of image 1 (h, w) that lies on no plane reported, where planes were sought in all of it."""
    share = float((labels == 0).mean())
    message = f"{100 * share:.0f} % of image 1 lies on no plane found, or outside image 2"
    return Diagnostic("unexplained", "info", message, share)


def _second_motion(solution: Solution) -> Diagnostic:
    return Diagnostic(
        "single-plane",
        "warning",
        "all that is seen lies on nearly one plane, and a second motion explains it as well",
        solution.ambiguity.delta_chi2,
        "use a third image, a known direction of motion, or ground with more relief",
    )
