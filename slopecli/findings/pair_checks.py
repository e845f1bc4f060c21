"""Checks of the images, of their matches and of the lens, before any plane is found."""

from __future__ import annotations

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.findings.camera_checks import implausible_cameras
from slopecli.findings.codes import LIMITS
from slopecli.findings.facts import PairFacts
from slopecli.findings.wording import finding
from slopecli.geometry.camera import radial_term
from slopecli.geometry.motion import MOST_TERM, LensMisfit
from slopecli.geometry.orientation import kept_orientation
from slopecli.look.changes import lens_misfit
from slopecli.look.standing_still import Still
from slopecli.types import Camera, Diagnostic, FloatArray, Image, IntArray

INLIER_SHARE = 0.12  # of the tentative matches: fewer agree on a motion by chance
MIRRORED = 1 / 3  # share of triangles that keep their orientation: half of them by chance, nearly all of a right pair
COVER = "paint black what is fixed to the camera or the image, as landing gear or a logo"
REACHED = 0.8  # of the corner's distance from the axis, to which matches must reach for the distortion to be told there


def refuse_identical(image1: Image, image2: Image) -> None:
    """Raise NoAnswer when both images hold the same pixels."""
    if np.array_equal(image1.grey, image2.grey):
        remedy = "take the second image from another place, or check that two different files were given"
        raise NoAnswer("pure-rotation", "the two images are identical, so there is no parallax", remedy, value=0.0)


def refuse_unmatched(n_features: tuple[int, int], n_matches: int, n_inliers: int) -> None:
    """Raise NoAnswer when an image has too few features, or no more matches agree on one motion than by chance."""
    few = min(n_features)
    if few < LIMITS["low-texture"]:
        found = f"image {1 + n_features.index(few)} has only {few} distinctive point{'' if few == 1 else 's'}"
        remedy = "use sharper, larger, better exposed or closer images"
        raise NoAnswer("low-texture", f"{found}, {LIMITS['low-texture']:.0f} are needed", remedy, value=float(few))
    if n_inliers < LIMITS["no-overlap"] or n_inliers < INLIER_SHARE * n_matches:
        found = f"of {n_matches} tentative matches only {n_inliers} agree on one motion"
        remedy = "give two images that show the same ground, at most a factor of two apart in scale"
        raise NoAnswer(
            "no-overlap", f"{found} (at least {LIMITS['no-overlap']:.0f} needed)", remedy, value=float(n_inliers)
        )


def refuse_mirrored(x1: FloatArray, x2: FloatArray, surface: IntArray) -> None:
    """Raise NoAnswer when image 2 shows surfaces with left and right exchanged, which no motion of a camera does.

    x1, x2 : (n, 2) matches.  surface : (n,) what each lies on, see `kept_orientation`.
    """
    kept = kept_orientation(x1, x2, surface)
    if kept < MIRRORED:
        remedy = "flip it back, left to right or top to bottom"
        raise NoAnswer("poor-fit", "image 2 is mirrored", remedy, value=kept)


def mirrored(pair: PairFacts) -> list[Diagnostic]:
    """Raise NoAnswer when the dense matches are those of a mirrored image: parts of image 1 stand for surfaces."""
    evidence, (height, width) = pair.scene.evidence, pair.scene.shape1
    column, row = np.floor(8 * (evidence.uv1 + 0.5) / [width, height]).astype(np.int64).T
    refuse_mirrored(evidence.x1, evidence.x2, 8 * row + column)
    return []


def cameras_as_made(pair: PairFacts) -> list[Diagnostic]:
    """Warn of cameras as hardly any are made."""
    return implausible_cameras(pair.scene.camera1, pair.scene.camera2)


def image_notes(pair: PairFacts) -> list[Diagnostic]:
    """How the files were read, where that is unusual: rotation marks ignored, 16 bits mapped to 8."""
    noted = [(number, image.note) for number, image in enumerate(pair.images, 1) if image.note]
    return [finding("image-note", f"image {number}: {note}", float(number)) for number, note in noted]


def stands_still(pair: PairFacts) -> list[Diagnostic]:
    """Say what belongs to the camera or the image, and was left out."""
    return still_notes(pair.scene.still)


def still_notes(still: Still | None) -> list[Diagnostic]:
    """What stands still, if anything does, as a note."""
    if still is None:
        return []
    message = f"{100 * still.share:.2g} % of the images stands still while the rest moves: it is not ground"
    return [finding("stands-still", message, still.share)]


def contradicting_matches(pair: PairFacts) -> list[Diagnostic]:
    """Raise NoAnswer when most of the dense matches contradict the motion of the camera; warn when many do."""
    evidence = pair.scene.evidence
    share = 1 - len(evidence) / max(evidence.n_given, 1)
    found = f"{100 * share:.0f} % of the dense matches contradict the"
    if share > 0.5:
        remedy = f"give two images of the same ground, neither mirrored, and the camera they were taken with; {COVER}"
        raise NoAnswer("no-overlap", f"{found} best motion of the camera", remedy, value=share)
    if share < LIMITS["dense-shadow-or-motion"]:
        return []
    message = f"{found} motion of the camera: shadows, vehicles or mismatches"
    remedy = f"distrust windows where something moved, or take both images in quick succession; {COVER}"
    return [finding("dense-shadow-or-motion", message, share, remedy)]


def lens_distortion(pair: PairFacts) -> list[Diagnostic]:
    """Warn when the matches fit another lens distortion than that of the camera file."""
    return check_lens(lens_misfit(pair.scene), pair.scene.camera1)


def check_lens(misfit: LensMisfit | None, camera: Camera) -> list[Diagnostic]:
    """Warn of a lens distortion that the camera file does not have.

    misfit : the distortion that the matches show; None where they do not show one clearly.
    camera : of image 1; both lenses are taken as alike.
    """
    if misfit is None:
        return []
    # normalised distance of the farthest corner from the principal point, before distortion
    x = max(camera.cx, camera.width - 1 - camera.cx) / camera.fx
    y = max(camera.cy, camera.height - 1 - camera.cy) / camera.fy
    corner = float(np.hypot(x, y))
    # a term of the third power is not extrapolated beyond the matches, nor believed where it is the largest allowed
    supported = misfit.reach >= REACHED * corner and abs(misfit.term) < MOST_TERM
    radius = corner if supported else min(misfit.reach, corner)
    size_px, sigma_px = (abs(value) * radius**3 * camera.focal_px for value in (misfit.term, misfit.sigma))
    if size_px < LIMITS["suspect-distortion"]:
        return []
    given = radial_term(camera)
    own = "besides that of the camera file" if camera.distortion else "which the camera file does not have,"
    as_far = f"{radius * camera.focal_px:.0f} px off the centre, as far as matches reach"
    message = (
        "residuals grow with the distance from the image centre as a lens distortion "
        f"{f'of k1 = {-misfit.term:.2g} ' if supported else ''}{own} would make them "
        f"({size_px:.1f} ± {sigma_px:.1g} px {'at the corner' if supported else as_far})"
    )
    remedy = "calibrate the lens, and give its distortion in the camera file"
    if abs(given - misfit.term) < 0.4 * abs(given):  # what is left of it is small
        remedy = (
            "the distortion seems to be taken out of the images already: give the camera they have since then (ROS: "
            "the projection_matrix P; OpenCV: the newCameraMatrix), or leave it out where the matrix was kept"
        )
    return [finding("suspect-distortion", message, size_px if supported else None, remedy)]
