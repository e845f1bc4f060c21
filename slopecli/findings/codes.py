"""Codes of diagnostics, of refusals and of rejected patches: one row a code and severity, with its documentation.

Everything that states a code takes it from here: messages their severity and general remedy (`wording.finding`),
docs/diagnostics.md its tables (`make docs`). Plain data; importing it loads nothing else.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

# "refusal" of a `NoAnswer` (exit status 3), "warning" and "info" of a diagnostic, "rejection" of a patch without an
# answer, whose reason the code is
Severity = Literal["refusal", "warning", "info", "rejection"]


class Code(NamedTuple):
    """One code at one severity.

    meaning : what was found and why it matters, a paragraph of Markdown.
    remedy : what to do, as messages say it; "" where there is nothing to do.
    value : what the number `value` is, with its unit; "" where there is none.
    forbids_safe : while such a diagnostic stands, no verdict is safe (`report.build_report`), and its message says so.
    """

    code: str
    severity: Severity
    meaning: str
    remedy: str = ""
    value: str = ""
    forbids_safe: bool = False


# severity -> code -> meaning, remedy, value, forbids_safe
_ROWS: dict[Severity, dict[str, tuple[Any, ...]]] = {
    "refusal": {
        "pure-rotation": (
            "A rotation of the camera alone explains all matches, or both images are the same: without parallax there "
            "is no depth.",
            "take the second image from another place, 5 to 20 % of the distance to the scene away",
            "px that a rotation leaves of the matches, or its angle in degrees",
        ),
        "no-overlap": (
            "Fewer matches agree on one motion than by chance: other ground, more than a factor of two in scale, "
            "another camera.",
            "give two images of the same ground",
            "matches that agree on one motion, or the share that contradicts it",
        ),
        "low-texture": (
            "An image, or every window, has too little texture to be matched.",
            "use sharper, larger, better exposed or closer images, or larger windows",
            "distinctive points in the poorer image",
        ),
        "up-unknown": (
            "No slope is known because up is not: nearly all of their sigmas is that of `--up-sigma`.",
            "give up with a smaller --up-sigma",
        ),
        "slope-open": (
            "Every slope is known worse than `--max-sigma`; or [correspondences of your own](solve.md) determine none "
            "of them, or put the planes behind the camera.",
            "raise --max-sigma, take the images farther apart, or give more rows, spread wider or known better",
        ),
        "low-parallax": (
            "[`slopemap plan`](plan.md): no baseline gives the sigma wanted.",
            "lengthen the baseline, give larger windows, or fly in another direction",
            "largest parallax, px",
        ),
        "single-plane": (
            "[`slopemap plan`](plan.md): straight towards ground that is one plane, no baseline tells the two "
            "possible motions apart.",
            "move sideways as well, or give --uneven DEG if the windows are not one plane",
        ),
        "poor-fit": (
            "Image 2 is mirrored: three points of one surface turn the other way round in it, which no motion of a "
            "camera brings about.",
            "flip it back, left to right or top to bottom",
            "share of triangles of matches that keep their orientation",
        ),
    },
    "warning": {
        "no-overlap": (
            "[`slopemap plan`](plan.md): one image would show the ground so much larger than the other that matching "
            "may fail.",
            "shorten the baseline",
            "ratio of the two scales",
        ),
        "low-parallax": (
            "Below 3 px of parallax, errors of the slopes are mostly the noise of matching.",
            "move as much farther between the images as the message says, in shares of the distance, or in metres "
            "where --baseline or --pose gives them",
            "median parallax, px",
        ),
        "upside-down": (
            "Every window of known slope is a ceiling (over 120°), as if the ground hung over the camera: `--up` "
            "points down.",
            "turn the sign of --up: it points against gravity, in camera-1 axes (x right, y down, z forward)",
            "how many windows",
        ),
        "level-assumed": (
            "What slopes are measured against was assumed, by `--up camera` or `--up dominant-plane`, and the images "
            "speak against it, or too little in them speaks for it ([how it is judged](conventions.md#what-is-level)). "
            "A facade before an upright camera looks like ground from above. A verdict is unsafe only where it is so "
            "against both directions. `--up X,Y,Z` is never doubted.",
            "give the direction against gravity with --up",
            "probability that what was assumed is level",
            True,
        ),
        "single-plane": (
            "All that is seen lies on one plane, and two motions explain it: both slopes are shown.",
            "use a third image, --direction-prior, --rotation-prior, --pose, or ground with more relief",
            "chi-square by which the second answer fits worse",
        ),
        "non-planar-patch": (
            "It is not one plane: relief, a step, a bent surface. Its status is poor, and it is never called safe.",
            "use smaller windows",
            "id of the window",
        ),
        "dense-shadow-or-motion": (
            "A connected area of at least 1 % became brighter or darker, as where a shadow moves, or moves "
            "differently from the rest, as vehicles do; or, all over the image, 15 % of the matches contradict the "
            "motion. The windows touched are named with the share of each.",
            "distrust windows that are touched, or take both images in quick succession",
            "share of image 1",
        ),
        "outside-image": (
            "Correspondences of your own lie outside the image that their camera is for. A matcher finds none there: "
            "they may be of another image or size, or mismatches.",
            "leave them out, and check that the camera is for the size of the images that were matched",
            "share of the rows",
        ),
        "implausible-camera": (
            "Hardly any camera is like this: a principal point more than a quarter of the image off its middle (17 % "
            "where the camera comes without an image size, less where it fits another size), a focal length outside "
            "0.3 to 25 image widths unless it is a fisheye lens, pixels half as long again as wide, or distortion that "
            "leaves half of the image without rays. Crops and the longest lenses do have such cameras.",
            "check the unit, which is pixels, and the image size that the camera is for",
            "number of the image",
            True,
        ),
        "suspect-distortion": (
            "Residuals grow from the image centre as another lens distortion than that of the camera file makes them. "
            "Its k1 is named; a lens distortion that was taken out of the images already shows in the same way.",
            "calibrate the lens, and give its distortion in the camera file; or, of undistorted images, the matrix "
            "that they were undistorted to (P of ROS, newCameraMatrix of OpenCV)",
            "px at the corner of image 1, null where matches do not reach so far",
            True,
        ),
        "suspect-camera": (
            "The matches fit another camera than that given: its focal length (or principal point) is named where it "
            "explains them clearly better than the others, with its 1-sigma, and by how much slopes with the one "
            "given are off ([how](cameras.md#the-images-test-the-camera)). A rolling shutter does the same as a wrong "
            "camera. The camera given is used all the same.",
            "solve with the focal length that the images prefer by --free-focal, or check the camera file",
            "focal length that the images prefer over the one given",
            True,
        ),
        "poor-fit": (
            "Matches miss their epipolar lines by more than 0.5 px, or the joint solution did not converge. Blur, a "
            "rolling shutter and moving things do the same as a wrong camera file; so does `--solver lh`, or `ha` "
            "that did not converge: use `mle`.",
            "check the camera file and its distortion, and that nothing in view moved",
            "noise of the matches, px",
        ),
        "planes-contradict": (
            "Each window or region fits a plane, and together they fit no motion of one camera: matches miss their "
            "epipolar lines by more than 0.5 px, and by twice what they miss their own planes by, and no single one "
            "is to blame. Several of them moved, belong to the camera (landing gear, a logo), or are mismatched, and "
            "they pull the motion, and so all slopes, with them. Or the camera file is wrong.",
            "check the camera file and its distortion; if they are right, leave out what moved or is mismatched",
            "noise of the matches, px",
            True,
        ),
        "metadata-contradicted": (
            "The motion that the images show is not the one that their metadata state: it goes another way than from "
            "one position to the other, or turns by another angle than the gimbal did. Where one of the images would "
            "agree if it were turned, as by a viewer that writes its pixels anew and leaves the angles as they were, "
            "the message says so. Level or north is then wrong as well. Or the up that was given is not the one that "
            "image 1 states, as with a wrong sign of `--pitch`. Of a sequence: a frame is turned "
            "otherwise than `--priors` say, or the angles of its frames contradict each other.",
            "check that both files are as the camera wrote them, and of one flight; or give --pitch, --roll and --yaw",
            "degrees between the two directions, or angles",
            True,
        ),
        "position-contradicted": (
            "`--position` is more than a kilometre from where image 1 says that it was taken. The one given is used.",
            "check the order (latitude, longitude) and the signs of --position; --metadata takes what is stated",
            "metres between the two",
        ),
        "prior-contradicted": (
            "The images contradict `--rotation-prior`, `--direction-prior` or `--pose`, which was left out.",
            "check its axes and its direction (camera 2 from camera 1), or give it a larger sigma",
            "chi-square",
        ),
    },
    "info": {
        "low-parallax": (
            "Windows are undecided, or their slope is unknown to `--max-sigma`, and a longer move, up to a quarter of "
            "the distance, would settle it.",
            "move as much farther between the images as the message says",
            "times as far as now",
        ),
        "stands-still": (
            "An area of at least 1 % looks the same at the same pixels of both images, while the rest moves: landing "
            "gear, a rotor guard, a logo. It is no ground, and counts as ground without matches. In images "
            "without a rotation between them, things at infinity, as clouds, do the same.",
            "choose windows clear of it",
            "share of the images",
        ),
        "partly-seen": (
            "Their sigmas are mostly due to ground without matches: outside image 2, hidden, or bare. It may have "
            "another slope than the matched part; a longer move does not help.",
            "choose windows in what both images show, or give the image that shows less of the ground first (the "
            "later one of a descent)",
            "how many windows",
        ),
        "step-or-object": (
            "Their sigmas are mostly due to parts that are not on their planes: across a step, or something that "
            "stands on the ground or moves (a box, a vehicle, a tree). The slope is that of the larger part.",
            "choose windows clear of it, or smaller ones",
            "how many windows",
        ),
        "single-plane": (
            "All that is seen lies on one plane, and only one motion is left; it is estimated from that plane alone.",
            "choose ground with more relief, or give what else is known of the motion, to know it better",
            "px, or mrad without a camera, within which nine tenths of the matches lie of it",
        ),
        "weak-geometry": (
            "A straight move along the normal that all planes share (motion within 15°, slopes alike to 5°): of all "
            "motions this one determines slopes least.",
            "move sideways as well; or give --rotation-prior, or --merge-coplanar where windows lie on one plane",
            "degrees between the motion and the normal of the ground",
        ),
        "foe-in-window": (
            "The camera moves along a line of sight through it, where there is no parallax.",
            "move sideways as well, or choose another window",
            "id of the window",
        ),
        "noise-exceeded": (
            "Residuals of correspondences of your own exceed `--noise` by more than chance, and sigmas are based on "
            "the residuals.",
            "give the noise they have with --noise",
            "residuals, px or mrad",
        ),
        "relief": (
            "Rows of planes of your own are off along their epipolar lines by more than their noise: they were solved "
            "as rough ground, and its relief is in the sigmas.",
            "use smaller patches",
            "how many planes",
        ),
        "prior-contradicted": (
            "They differ by more than chance, though by no more than errors of calibration and interpolation: both "
            "were used, with larger sigmas of matches.",
            "check the camera file, or give it a larger sigma",
            "chi-square",
        ),
        "coplanar": (
            "With `--merge-coplanar`: these windows lie on one plane, or face one way, and were solved so.",
            "leave out --merge-coplanar to have each by itself",
            "by how much the sigma went down",
        ),
        "unexplained": ("Where planes are sought in all of the image: how much lies on none.", "", "share of image 1"),
        "focal-length": (
            "Which focal length the slopes were computed with, and its 1-sigma, where it is not the one given: "
            "`--free-focal`, or `--focal-sigma` where the images tell it better. Or that `--free-focal` found the "
            "images to tell none, or one from which the one given differs by no more than its sigma, and the one "
            "given was used.",
            "",
            "focal length used over the one given",
        ),
        "frame-skipped": (
            "[`slopemap sequence`](sequence.md): frames that tell nothing were left out: of another size, dark, "
            "repeated, blurred, of other ground, or without parallax at the start. The answer is as if they had not "
            "been there.",
            "",
            "how many",
        ),
        "pitch-sign": (
            "The up that was given makes all that is seen steep, and with the opposite sign of `--pitch` (of the third "
            "number of `--up`) most of it would be far nearer to level. It is used as given: hillsides are so, too.",
            "check the sign: --pitch -90 looks straight down, and up is 0,0,-1 then",
            "the median slope then, degrees",
        ),
        "metadata": (
            "What was taken from the [metadata of the images](drone.md), or was asked for and is not stated there.",
        ),
        "image-note": (
            "How a file was read: a rotation mark left alone, 16 bits mapped to 8.",
            "",
            "number of the image",
        ),
    },
    "rejection": {
        "no-overlap": ("image 2 does not show it",),
        "low-texture": ("too little texture, or its matches do not determine the slope",),
        "poor-fit": ("it has texture, and yet no match: something else may be there in image 2",),
        "unsettled": (
            "the joint solution does not settle with it: its matches put it behind a camera, or at infinity, or "
            "contradict the motion that the others agree on. The others are solved without it",
        ),
        "up-unknown": ("nearly all of its sigma is that of up",),
        "slope-open": (
            "its slope is known worse than `--max-sigma`; or [correspondences of your own](solve.md): its rows do not "
            "determine the slope, or put it behind the camera",
        ),
        "too-few-points": ("[correspondences of your own](solve.md): fewer than three, or on one line",),
    },
}

# the value from which on, or below which, a diagnostic is given; other checks have their numbers where they are made
LIMITS = {
    "low-texture": 60.0,
    "no-overlap": 20.0,
    "low-parallax": 3.0,  # below it errors of slopes are mostly matching noise
    "dense-shadow-or-motion": 0.15,
    "suspect-distortion": 1.0,  # at the corner
    "non-planar-patch": 0.025,  # RMS height off the plane over its distance
    "poor-fit": 0.5,  # beyond it the cameras or the images are suspect
}
CODES = tuple(Code(code, severity, *texts) for severity, rows in _ROWS.items() for code, texts in rows.items())
