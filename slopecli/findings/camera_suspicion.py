"""What is said where images contradict the cameras: which number explains it, how far slopes are off, a remedy."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from slopecli.errors import SlopemapError
from slopecli.findings.camera_test import TEST, Cameras, CameraTest
from slopecli.findings.pair_checks import COVER, check_lens
from slopecli.findings.wording import finding
from slopecli.geometry.motion import LensMisfit
from slopecli.geometry.solver.free_camera import Freed
from slopecli.geometry.solver.intrinsics import PARAMETERS, Settled
from slopecli.geometry.solver.seen_points import changed
from slopecli.measure import measure
from slopecli.options import Options
from slopecli.patches.join import Joined
from slopecli.patches.sightings import seen_by
from slopecli.types import Camera, Diagnostic, Solution

Again = Callable[[Joined, Cameras, Settled], Solution]  # solves matches again, seen by other cameras, from a start

UNTOLD = "the images contradict the camera, and it cannot be told in which of its numbers"
UNEXPLAINED = (
    "the images contradict the camera, or much in them moved: places outside the windows miss their epipolar lines "
    "several times as far as the matches in them, and no focal length explains both"
)
CHECK_FILE = "check that the camera file belongs to these images, uncropped and not zoomed"


class _Explained(NamedTuple):
    """Which of `PARAMETERS` explains the matches, "" where none does clearly better; all of them, freed alone."""

    name: str
    freed: dict[str, Freed]
    noise_px: float

    @property
    def told(self) -> str:
        """What the message names: not a lens term, and where the focal length cannot be freed a parameter that can."""
        name = self.name if self.name != "k1" else ""
        return name if name or "f" in self.freed else next(one for one in ("cx", "cy", "k1") if one in self.freed)

    @property
    def explains(self) -> bool:
        """Whether any reduces the noise."""
        return TEST.clearly * min(one.score.noise_px for one in self.freed.values()) < self.noise_px


def suspicion(
    test: CameraTest,
    joined: Joined,
    solution: Solution,
    options: Options,
    again: Again,
    known: list[Diagnostic],
    can_free: bool = True,
) -> list[Diagnostic]:
    """The diagnostics of a pair, with one on the camera where the images contradict it.

    known : diagnostics so far.  again : solves the same matches as seen by other cameras.
    can_free : whether the command has `--free-focal`.
    """
    if not (test.suspect or test.centre) or test.sightings is None or test.score is None:
        return known
    found = _explained(test)
    if test.only_contradicted and (found is None or found.name in ("", "f")):
        return [*known, finding("suspect-camera", UNEXPLAINED, None, f"{CHECK_FILE}; {COVER}")]
    if found is None:
        return [*known, finding("suspect-camera", UNTOLD, test.focal_factor, CHECK_FILE)]
    others = [one for one in known if one.code != "suspect-distortion"]
    if len(others) < len(known) and found.name in ("", "k1"):
        return known
    cameras = test.sightings.cameras
    if found.name == "k1" and (lens := _lens(found, joined, cameras[0])):
        return [*others, *lens]
    name = found.told
    freed = name or "f"
    off = _slopes_off(found.freed[freed], freed, joined, solution, cameras, options, again)
    message, remedy = _words(name, found, cameras, off, can_free)
    return [*others, finding("suspect-camera", message, test.focal_factor, remedy)]


def _lens(found: _Explained, joined: Joined, camera: Camera) -> list[Diagnostic]:
    """The diagnostic of a lens whose k1 explains the matches; none where it is no clear misfit."""
    k1 = found.freed["k1"]
    reach = float(np.quantile(np.linalg.norm(joined.matches.x1, axis=1), 0.95))
    return check_lens(LensMisfit(-k1.value, float(k1.score.sigma[3]), found.noise_px, k1.score.noise_px, reach), camera)


def _explained(test: CameraTest) -> _Explained | None:
    """Free each parameter alone, and name that with the least noise if no other comes near; None if none can be freed.

    All are compared on the same matches. The focal length stated is that of `test`, of all matches.
    """
    freed = {name: one for name in PARAMETERS if (one := test.alone(name)) is not None}
    if not freed or test.score is None or ("f" not in freed and not test.centre):
        return None
    best, *others = sorted(freed, key=lambda name: freed[name].score.noise_px)
    noise, before = freed[best].score.noise_px, test.score.noise_px
    clear = TEST.clearly * noise < min([before, *(freed[other].score.noise_px for other in others)])
    focal = freed.get("f")
    if focal is not None and test.start is not None:
        sigmas = np.append(test.sigma, focal.score.sigma[1:])
        freed["f"] = Freed(test.step, test.start, focal.cost, focal.score._replace(sigma=sigmas), focal.less_noise)
    return _Explained(best if clear else "", freed, before)


def _slopes_off(
    freed: Freed, name: str, joined: Joined, solution: Solution, cameras: Cameras, options: Options, again: Again
) -> float | None:
    """Largest difference of a slope, deg, to that with the value the images prefer; None where it cannot be solved."""
    first, second = (changed(camera, name, freed.value) for camera in cameras)
    other = seen_by(joined, (first, second))
    if len(other.patches) != len(joined.patches):
        return None
    try:
        right = measure(again(other, (first, second), freed.settled), other, options).slopes.slope_rad
    except SlopemapError:
        return None
    return float(np.degrees(np.abs(right - measure(solution, joined, options).slopes.slope_rad).max()))


def _words(name: str, found: _Explained, cameras: Cameras, off: float | None, can_free: bool) -> tuple[str, str]:
    """Message and remedy; name: of the parameter that explains the matches, "" for none."""
    camera, best = cameras[0], found.freed[name or "f"]
    after, sigma = best.score.noise_px, float(best.score.sigma[PARAMETERS.index(name or "f")])
    better = f"matches miss it by {after:.2g} px instead of {found.noise_px:.2g} px"
    wrong = "" if off is None else f"; with the one given, slopes are off by up to {off:.2g}°"
    right = changed(camera, name or "f", best.value)
    if name in ("cx", "cy"):
        value, given = getattr(right, name), getattr(camera, name)
        what = f"the images fit a principal point with {name} = {value:.4g} ± {sigma * camera.focal_px:.2g} px"
        remedy = (
            f"check the principal point of the camera file: is it that of this image, not cropped? {name} = {value:.5g}"
        )
        return f"{what}, and {given:.4g} px was given: {better}{wrong}", remedy
    times = float(np.exp(best.value))
    what = f"a focal length of {right.focal_px:.4g} ± {times * sigma * camera.focal_px:.2g} px"
    given = f"{camera.focal_px:.4g} px"
    solve = f"--free-focal solves with that focal length ({times:.4g} times the one given)" if can_free else ""
    if name:
        numbers = ",".join(f"{v:.6g}" for v in (right.fx, right.fy, right.cx, right.cy))
        give = f"give it (--intrinsics {numbers})" if not camera.distortion else "correct fx and fy in the file"
        remedy = f"{solve}, or {give}" if solve else f"check the focal length, and {give}: {times:.4g} times as long"
        return f"the images fit {what}, and {given} was given: {better}{wrong}", remedy
    if found.explains:
        message = f"the images contradict the camera; {what} instead of {given} fits better, and so would another "
        message += f"principal point or lens: {better}{wrong}"
        return message, f"{CHECK_FILE}; {solve}" if solve else CHECK_FILE
    message = f"the images contradict the camera, and none of its numbers explains it ({what} would fit best): a "
    message += "rolling shutter or things that moved do the same"
    return f"{message}{wrong}", f"{CHECK_FILE}; hold the camera still, or use one with a global shutter"
