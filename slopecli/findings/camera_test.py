"""What the images say of the cameras: the focal length they prefer, and whether they contradict what was given."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration
from slopecli.geometry.epipolar import epipolar_distance, essential_matrix
from slopecli.geometry.solver.free_camera import (
    ByLines,
    Freed,
    focal_by_lines,
    free_focal,
    free_focal_nearby,
    free_parameter,
    lines_explain,
)
from slopecli.geometry.solver.intrinsics import PARAMETERS, CameraScore, Settled, score_camera, with_planes
from slopecli.geometry.solver.seen_points import Sightings, changed
from slopecli.look.scene import Scene
from slopecli.patches.given import RAYS
from slopecli.patches.join import Joined
from slopecli.patches.sightings import every_sighting, sightings_of
from slopecli.types import Camera, Solution

Cameras = tuple[Camera, Camera]


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
    floor_share: float = 0.125  # the same, of the noise of matches: with it sigmas cover photographs of right cameras
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
    used : whether the focal length was free, and the images tell it: the sigma that is reported then holds `floor`.
    preferred : the score under the focal length preferred, None if it was not freed.
    """

    step: float = 0.0
    sigma: float = np.inf
    suspect: bool = False
    score: CameraScore | None = None
    sightings: Sightings | None = None
    start: Settled | None = None
    centre: bool = False
    used: bool = False
    preferred: CameraScore | None = None
    alone: Callable[[str], Freed | None] = lambda parameter: None

    @property
    def focal_factor(self) -> float | None:
        """The focal length that the images prefer over the one given; None where they do not tell it."""
        return float(np.exp(self.step)) if self.sigma < TEST.telling else None

    @property
    def focal_factor_sigma(self) -> float | None:
        """Its 1-sigma."""
        sigma = float(np.hypot(self.sigma, self.floor if self.used else 0.0))
        return float(np.exp(self.step)) * sigma if self.sigma < TEST.telling else None

    @property
    def floor(self) -> float:
        """1-sigma of its logarithm by what lens models, shutters and matches leave alike all over the image."""
        score = self.preferred or self.score
        if score is None:
            return float(np.inf)
        return max(TEST.floor_px, TEST.floor_share * score.noise_px) / max(float(score.px[0]), 1e-9)

    @property
    def only_contradicted(self) -> bool:
        """Whether the cameras are contradicted and no focal length was found that explains it."""
        return self.suspect and not np.isfinite(self.sigma)


def examine_cameras(
    joined: Joined,
    solution: Solution,
    cameras: Cameras,
    scene: Scene | None = None,
    *,
    free: bool = False,
    patches_tell: bool = False,
) -> CameraTest:
    """Test the cameras by the residuals of the joint solution; 5 to 10 ms, and 0.1 to 0.3 s where these ask for more.

    scene : of the matches, None for a user's own correspondences.  free : free the focal length in any case.
    patches_tell : take the focal length from the matches of the patches alone, as these are all over image 1.
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
    lines = None
    if not (free or contradicted):
        lines = focal_by_lines(every, start.noise) if _may_be_wrong(score) else None
        if not (lines and lines.elsewhere) and (enough := _told_nearby(test, score, sightings, start)):
            return enough
    freed = free_focal(every, start, None if free else _is_far, lines)
    freed = _by_patches(freed, every) if patches_tell else freed
    if freed and contradicted and _explains_nothing(freed, joined, every, start, free):
        freed = None
    return _told_by(freed, test, score, contradicted)


def _by_patches(freed: Freed | None, every: Sightings) -> Freed | None:
    """A focal length freed, by the matches of the patches alone where these tell it.

    The overview is too coarse for one that slopes are computed with: its errors are alike all over the image, and put
    right cameras off by half as much again.
    """
    if freed is None:
        return None
    cameras = changed(every.cameras[0], "f", freed.value), changed(every.cameras[1], "f", freed.value)
    own = replace(every.take(np.flatnonzero(every.patch >= 0)).seen_by(cameras).with_rays(), gain=every.gain)
    here = ByLines((0.0, (freed.settled.R, freed.settled.T)))
    again = free_focal(own, freed.settled, lines=here)
    if again is None or not _sigma(again.score) < TEST.telling:
        return freed
    return again._replace(value=freed.value + again.value, less_noise=freed.less_noise)


def _told_by(freed: Freed | None, test: CameraTest, score: CameraScore, contradicted: bool) -> CameraTest:
    """The test with a focal length freed, or without one; contradicted : as in `_is_wrong`."""
    if freed is None:
        return replace(test, suspect=contradicted and _sigma(score) < TEST.telling)
    wrong = _is_wrong(freed, contradicted)
    sigma = float(freed.score.sigma[0]) if wrong else _sigma(freed.score)
    return replace(test, step=freed.value, sigma=sigma, suspect=wrong, start=freed.settled, preferred=freed.score)


def _explains_nothing(freed: Freed, joined: Joined, every: Sightings, start: Settled, used: bool) -> bool:
    """Whether the overview contradicts the cameras no less with a focal length freed.

    used : whether slopes are computed with it. Else what it leaves may be mismatches, which lie on no lines.
    """
    if _is_wrong(freed, True) or not _overview_contradicts(joined, every, freed.settled, freed.value):
        return False
    return used or lines_explain(every, slice(len(joined.plane), None), start)


def _told_nearby(test: CameraTest, score: CameraScore, sightings: Sightings, start: Settled) -> CameraTest | None:
    """The test with the step of the score, or a focal length freed nearby; None where both come near to a wrong one."""
    if not _asks_for_more(score):
        return replace(test, step=float(score.step[0]), sigma=_sigma(score))
    near = free_focal_nearby(sightings, start)
    if near is None or _comes_near(near.value, near.score):
        return None
    return replace(test, step=near.value, sigma=_sigma(near.score))


def _may_be_wrong(score: CameraScore) -> bool:
    """Whether a focal length that is wrong enough to be told is within 2 sigmas of the step of the score, roughly."""
    step, sigma = float(score.step[0]), float(score.sigma[0])
    told = sigma < TEST.telling or (sigma < 1.0 and score.px[0] > TEST.faint * score.noise_px)
    return bool(told and abs(step) + 2.0 * sigma > TEST.least_wrong)


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
