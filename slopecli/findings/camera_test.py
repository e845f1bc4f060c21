"""What the images say of the cameras: the focal length they prefer, and whether they contradict what was given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration, SlopemapError
from slopecli.findings.pair_checks import check_lens
from slopecli.findings.wording import finding
from slopecli.geometry.epipolar import epipolar_distance, essential_matrix
from slopecli.geometry.motion import LensMisfit
from slopecli.geometry.solver.free_camera import Freed, focal_by_lines, free_focal, free_focal_nearby, free_parameter
from slopecli.geometry.solver.intrinsics import PARAMETERS, CameraScore, Settled, score_camera, with_planes
from slopecli.geometry.solver.seen_points import Sightings, changed
from slopecli.look.scene import Scene
from slopecli.measure import measure
from slopecli.options import Options
from slopecli.patches.given import RAYS
from slopecli.patches.join import Joined
from slopecli.patches.sightings import every_sighting, seen_by, sightings_of
from slopecli.types import Camera, Diagnostic, Solution

Cameras = tuple[Camera, Camera]
Again = Callable[[Joined, Cameras, Settled], Solution]  # solves matches again, seen by other cameras, from a start

UNTOLD = "the images contradict the camera, and it cannot be told in which of its numbers"
UNEXPLAINED = (
    "the images contradict the camera, or much in them moved: places outside the windows miss their epipolar lines "
    "several times as far as the matches in them, and no focal length explains both"
)
CHECK_FILE = "check that the camera file belongs to these images, uncropped and not zoomed"


class CameraTestTunables(NamedTuple):
    """When the images contradict a camera, and when that is looked into; measured on pairs whose camera is known."""

    contradicted: float = 5.0  # sigmas of a freed focal length
    least_wrong: float = 0.035  # share by which it must be off: photographs of right cameras ask for up to 3 %
    unlikely: float = 2.58  # sigmas that 1 in 100 exceeds: enough where the matches are clearly nearer with another one
    systematic: float = 0.015  # 1-sigma of the focal length that photographs of right cameras ask for, beyond their own
    nearly: float = 0.9  # of what is called wrong: step of the score that is looked into; wrong ones reach 1
    faint: float = 0.5  # of the noise: change of residuals by a parameter below which a large sigma is no fault of it
    far: float = 4.0  # times as far from epipolar lines as the matches, for the farthest tenth of the overview's cells
    floor_px: float = 0.01  # systematic residual that f could explain; lens models and interpolation leave 0.02
    centre_share: float = 0.03  # of the focal length: step of the principal point from which on it is freed
    centre_better: float = 1.15  # ratio of noises by which another principal point is believed; right ones reach 1.09
    telling: float = 0.1  # 1-sigma of its logarithm beyond which the images do not tell it
    clearly: float = 1.05  # ratio of noises from which on one parameter explains the matches better than another
    few_free: int = 30  # degrees of freedom: with fewer, sigmas are guesses


TEST = CameraTestTunables()


@dataclass(frozen=True, eq=False)
class CameraTest:
    """What the images say of the focal length.

    step, sigma : logarithm of the focal length they prefer over that given, and its 1-sigma, infinite where they do not
    tell it.  suspect : whether they contradict the one given.  centre : whether they contradict the principal point.
    score, sightings : what it was computed from; None where there is nothing to compute it from.
    alone : frees one of `PARAMETERS` alone, and remembers the result.
    start : the solution under the focal length preferred, None if it was not freed.
    """

    step: float = 0.0
    sigma: float = np.inf
    suspect: bool = False
    score: CameraScore | None = None
    sightings: Sightings | None = None
    start: Settled | None = None
    centre: bool = False
    alone: Callable[[str], Freed | None] = lambda parameter: None

    @property
    def focal_factor(self) -> float | None:
        """The focal length that the images prefer over the one given; None where they do not tell it."""
        return float(np.exp(self.step)) if self.sigma < TEST.telling else None

    @property
    def focal_factor_sigma(self) -> float | None:
        """Its 1-sigma."""
        return float(np.exp(self.step)) * self.sigma if self.sigma < TEST.telling else None

    @property
    def only_contradicted(self) -> bool:
        """Whether the cameras are contradicted and no focal length was found that explains it."""
        return self.suspect and not np.isfinite(self.sigma)


def examine_cameras(
    joined: Joined, solution: Solution, cameras: Cameras, scene: Scene | None = None, *, free: bool = False
) -> CameraTest:
    """Test the cameras by the residuals of the joint solution; 5 to 10 ms, and 0.1 to 0.3 s where these ask for more.

    scene : of the matches, None for a user's own correspondences.  free : free the focal length in any case.
    """
    spare = 2 * int(solution.inlier.sum()) - 5 - 3 * len(solution.scaled_normals)
    if cameras[1] is RAYS or spare < TEST.few_free:
        return CameraTest()
    sightings, start = with_planes(sightings_of(joined, solution, cameras), Settled.of(solution))
    try:
        score = score_camera(sightings, start)
    except DegenerateConfiguration:  # what the solution kept is too little for a plane
        return CameraTest()
    alone = cache(partial(free_parameter, sightings, start))
    centre = _centre_is_wrong(alone, score, sightings, start)
    test = CameraTest(score=score, sightings=sightings, centre=centre, alone=alone)
    every = every_sighting(joined, cameras, solution.noise_gain, scene)
    contradicted = _overview_contradicts(joined, every, start)
    asked = not free and not contradicted
    lines = focal_by_lines(every, start.noise) if asked and _may_be_wrong(score) else None
    if asked and not (lines and lines.elsewhere) and (enough := _told_nearby(test, score, sightings, start)):
        return enough
    freed = free_focal(every, start, None if free else _is_far, lines)
    wrong = freed is not None and _is_wrong(freed, contradicted)
    doubted = contradicted and not wrong
    if freed is None or (doubted and _overview_contradicts(joined, every, freed.settled, freed.value)):
        return replace(test, suspect=contradicted and _sigma(score) < TEST.telling)
    sigma = float(freed.score.sigma[0]) if wrong else _sigma(freed.score)
    return replace(test, step=freed.value, sigma=sigma, suspect=wrong, start=freed.settled)


def _told_nearby(test: CameraTest, score: CameraScore, sightings: Sightings, start: Settled) -> CameraTest | None:
    """The test with the step of the score, or a focal length freed nearby; None where both come near to a wrong one."""
    if not _asks_for_more(score):
        return replace(test, step=float(score.step[0]), sigma=_sigma(score))
    near = free_focal_nearby(sightings, start)
    if near is None or _comes_near(near.value, near.score):
        return None
    return replace(test, step=near.value, sigma=_sigma(near.score))


def _may_be_wrong(score: CameraScore) -> bool:
    """Whether a focal length that is wrong enough to be told is within 1 sigma of the step of the score, roughly."""
    step, sigma = float(score.step[0]), float(score.sigma[0])
    told = sigma < TEST.telling or (sigma < 1.0 and score.px[0] > TEST.faint * score.noise_px)
    return bool(told and abs(step) + sigma > TEST.least_wrong)


def _asks_for_more(score: CameraScore) -> bool:
    """Whether the step of the score itself comes near to what is called wrong: those of wrong cameras exceed it."""
    return _may_be_wrong(score) and _comes_near(float(score.step[0]), score)


def _comes_near(value: float, score: CameraScore) -> bool:
    """Whether a step of the focal length is nearly as long as the least that is called wrong."""
    likely = TEST.unlikely * np.hypot(float(score.sigma[0]), TEST.systematic)
    return bool(abs(value) > TEST.nearly * max(TEST.least_wrong, likely))


def _is_far(freed: Freed) -> bool:
    """Whether a focal length is half as far off as what is called wrong at the least."""
    return abs(freed.value) > 0.5 * TEST.unlikely * np.hypot(float(freed.score.sigma[0]), TEST.systematic)


def _overview_contradicts(joined: Joined, every: Sightings, start: Settled, value: float = 0.0) -> bool:
    """Whether cells of the overview miss the epipolar lines by far more than the matches do, chosen to fit these.

    value : logarithm of the focal length under which `start` was found, over that of the cameras.
    """
    count = len(joined.plane)
    if len(every.patch) < count + TEST.few_free:
        return False
    if value:
        every = every.seen_by((changed(every.cameras[0], "f", value), changed(every.cameras[1], "f", value)))
    miss = np.abs(epipolar_distance(essential_matrix(start.R, start.T), *every.rays()))
    of_matches, of_cells = (np.quantile(some, 0.9) for some in (miss[:count], miss[count:]))
    return bool(of_cells > TEST.far * of_matches)


def _is_wrong(freed: Freed, contradicted: bool) -> bool:
    """Whether the best focal length contradicts the one given: by 5 sigmas, or by fewer and clearly less noise.

    contradicted : whether the overview contradicts the cameras. Then either is enough: fewer sigmas, or less noise.
    """
    step, sigma = abs(freed.value), float(freed.score.sigma[0])
    if abs(np.expm1(freed.value)) < TEST.least_wrong or sigma > TEST.telling:
        return False
    clearly, likely = freed.less_noise > TEST.clearly, step > TEST.unlikely * np.hypot(sigma, TEST.systematic)
    if (clearly and likely) or (contradicted and (clearly or likely)):
        return True
    if freed.less_noise < 1.0:  # the matches are no nearer: what is left may be what lenses and interpolation leave
        floor = TEST.floor_px / max(float(freed.score.px[0]), 1e-9)
        return bool(step > TEST.contradicted * np.hypot(_sigma(freed.score), floor))
    return step > TEST.contradicted * _sigma(freed.score)


def _centre_is_wrong(
    alone: Callable[[str], Freed | None], score: CameraScore, sightings: Sightings, start: Settled
) -> bool:
    """Whether another principal point explains the matches, and clearly better than another focal length does."""
    told = score.px > TEST.faint * score.noise_px
    asked = [
        k for k in (1, 2) if told[k] and abs(score.step[k]) > max(TEST.contradicted * score.sigma[k], TEST.centre_share)
    ]
    noises = []
    for k in asked:
        freed = alone(PARAMETERS[k])
        if (
            freed is not None
            and abs(freed.value) > TEST.contradicted * freed.score.sigma[k] < TEST.contradicted * TEST.telling
        ):
            noises.append(freed.score.noise_px)
    if not noises or TEST.centre_better * min(noises) > score.noise_px:
        return False
    nearby = free_parameter(sightings, start, "f", steps=False)
    if nearby is not None and nearby.score.noise_px <= TEST.clearly * min(noises):
        return False
    focal = alone("f")
    return focal is None or focal.score.noise_px > TEST.clearly * min(noises)


def _sigma(score: CameraScore) -> float:
    """1-sigma of the step of log f; infinite where residuals change by less than their noise while f doubles or so.

    There the step is no longer linear in the residuals.
    """
    return float(score.sigma[0]) if score.px[0] > score.noise_px else np.inf


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
        return [*known, finding("suspect-camera", UNEXPLAINED, None, CHECK_FILE)]
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
