"""What other sensors tell of the frames: up and north by their attitudes, and lengths by positions and altitudes.

Errors of a sensor repeat from frame to frame, so a mean of several is taken to be as sure as the surest of them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from slopecli.errors import InputError
from slopecli.findings.wording import finding
from slopecli.geometry.epipolar import rotation_vector
from slopecli.geometry.statistics import GATE_SIGMAS, median
from slopecli.options import Options
from slopecli.report.units import LEVEL_LOOK
from slopecli.sequence.frame import FramePrior, FrameState
from slopecli.sequence.view_estimator import ViewEstimator
from slopecli.types import Diagnostic, FloatArray, Report

REMEDY = "check their order and signs (a pitch of -90 looks straight down), that rows and frames go together"


class _Seen(NamedTuple):
    """A frame that was used, of which something is known: its motion, and what is known."""

    R: FloatArray
    T: FloatArray
    prior: FramePrior
    frame: int


def _seen(used: list[FrameState]) -> list[_Seen]:
    return [
        _Seen(state.R, state.T, state.prior, state.frame)
        for state in used
        if state.R is not None and state.T is not None and state.prior is not None
    ]


def with_priors(options: Options, used: list[FrameState], estimator: ViewEstimator) -> Options:
    """The options with up, north and the length of the first move, m, as the frames used tell them.

    Those that are known otherwise stay.

    Raises
    ------
    InputError : altitudes are given for a camera that looks along the horizon, or up, or where up is to be that of the
    largest plane.
    """
    seen = _seen(used)
    return _with_length(_with_attitude(options, seen), seen, estimator) if seen else options


class _Mean(NamedTuple):
    """Mean of a direction that frames state: unit, 1-sigma, deg (0 where none is stated); the statements that
    contradict the others: off, deg, the largest angle from the mean, the frame of it, and whether they are left out, as
    most frames agree without them."""

    direction: tuple[float, float, float]
    sigma_deg: float
    off_deg: float
    frame: int
    left_out: bool


def _up(seen: list[_Seen]) -> _Mean | None:
    return _mean([(-(one.prior.ned @ one.R)[2], one) for one in seen if one.prior.ned is not None])


def _north(seen: list[_Seen]) -> _Mean | None:
    return _mean([((one.prior.ned @ one.R)[0], one) for one in seen if one.prior.ned is not None and one.prior.heading])


def _with_attitude(options: Options, seen: list[_Seen]) -> Options:
    """The options with the mean of up, and of north, in the axes of the first frame."""
    if options.up == "camera" and (up := _up(seen)):
        sigma = _not_below(options.up_sigma_deg, up)
        options = replace(options, up=up.direction, up_sigma_deg=sigma)
    if options.north is None and (north := _north(seen)):
        sigma = _not_below(options.north_sigma_deg, north)
        options = replace(options, north=north.direction, north_sigma_deg=sigma)
    return options


def _not_below(given_deg: float, mean: _Mean) -> float:
    """The sigma given, or that of the mean; where statements contradict each other and none is right, the larger."""
    disputed = mean.off_deg > 0.0 and not mean.left_out
    return max(given_deg, mean.sigma_deg) if disputed else given_deg or mean.sigma_deg


def _mean(parts: list[tuple[FloatArray, _Seen]]) -> _Mean | None:
    """Weighted mean of directions that frames state, in the axes of the first; None of none.

    Those farther from the median of all than five sigmas are left out if most are nearer. If not, there is nothing to
    tell which are right: all count, and the sigma is the RMS of their angles from the mean.
    """
    if not parts:
        return None
    every = np.array([direction for direction, _ in parts])
    sigmas = np.array([one.prior.attitude_sigma_deg or np.nan for _, one in parts])
    weight = _weights(sigmas)
    off = _angles_deg(every, np.median(every, axis=0))
    far = off > 2.0 * GATE_SIGMAS * weight**-0.5
    left_out = bool(far.any() and 2 * np.count_nonzero(far) < len(far))
    kept = ~far if left_out else np.ones(len(far), bool)
    total = every[kept].T @ weight[kept]
    off = _angles_deg(every, total)
    x, y, z = (float(value) for value in total / np.linalg.norm(total))
    known = sigmas[kept][np.isfinite(sigmas[kept])]
    sigma = float(known.min()) if len(known) else 0.0
    if far.any() and not left_out:
        sigma = max(sigma, float(np.sqrt(np.mean(off**2))))
    worst = int(np.argmax(np.where(far, off, -1.0)))
    return _Mean((x, y, z), sigma, float(off[worst]) if far.any() else 0.0, parts[worst][1].frame, left_out)


def _angles_deg(directions: FloatArray, other: FloatArray) -> FloatArray:
    """(n,) angles of unit directions (n, 3) from another."""
    return np.asarray(np.degrees(np.arccos(np.clip(directions @ (other / np.linalg.norm(other)), -1.0, 1.0))))


def _weights(sigmas: FloatArray) -> FloatArray:
    """Inverse variances; of those without a sigma (NaN) that of the mean of the others, or of 1 if there are none."""
    known = np.isfinite(sigmas)
    filled = np.where(known, sigmas, float(sigmas[known].mean()) if known.any() else 1.0)
    return np.asarray(filled**-2.0)


def _with_length(options: Options, seen: list[_Seen], estimator: ViewEstimator) -> Options:
    """The options with the length of the first move by least squares over all lengths known, and its relative sigma.

    It is that of the surest, and at least the RMS, weighted, by which the lengths differ from those of the images.
    """
    if options.baseline_m is not None or options.altitude_m is not None:
        return options
    rows = np.array([*_moves(seen), *_heights(options, seen, estimator)]).reshape(-1, 3)
    found, known, sigmas = rows.T
    if not (found > 0.0).any() or not (known > 0.0).any():
        return options
    weight = _weights(sigmas)
    length = float((weight * found) @ known / ((weight * found) @ found))
    share = 0.0 if np.isnan(sigmas).all() else 100.0 * float(np.nanmin(sigmas / np.maximum(known, 1e-12)))
    off = 100.0 * float(np.sqrt(weight @ (known - length * found) ** 2 / (weight @ known**2)))
    return replace(options, baseline_m=length, scale_sigma_percent=options.scale_sigma_percent or max(share, off))


def _moves(seen: list[_Seen]) -> list[tuple[float, float, float]]:
    """Distances of frames from the first: found, in first moves, known, m, and 1-sigma, NaN where it is not known.

    Their axes do not matter.
    """
    first = next((one.prior for one in seen if not one.T.any()), None)
    if first is None or first.position_m is None:
        return []
    return [
        (
            float(np.linalg.norm(one.T)),
            float(np.linalg.norm(np.subtract(one.prior.position_m, first.position_m))),
            float(np.hypot(one.prior.position_sigma_m or np.nan, first.position_sigma_m or np.nan)),
        )
        for one in seen
        if one.prior.position_m is not None and one.T.any()
    ]


def _heights(options: Options, seen: list[_Seen], estimator: ViewEstimator) -> list[tuple[float, float, float]]:
    """Heights of frames above the ground of the windows: found, in first moves, known, m, and 1-sigma."""
    told = [one for one in seen if one.prior.altitude_m is not None]
    if not told:
        return []
    if options.up == "dominant-plane":
        raise InputError("altitudes of frames need an up that is known: give --up X,Y,Z, or angles of the frames")
    up = np.array([0.0, 0.0, -1.0] if isinstance(options.up, str) else options.up, float)
    up /= np.linalg.norm(up)
    tracks, u = estimator.tracks, estimator.inverse_depth
    shown = estimator.alive & (u > 0.0) & (tracks.patch >= 0)
    P = tracks.p[:, shown] / u[shown]
    drop = median(-(up @ P))
    if drop < LEVEL_LOOK * median(np.linalg.norm(P, axis=0)):
        raise InputError(
            "altitudes of frames need ground below the camera, but what is seen lies level with it or above; give --up "
            "for this camera, or angles of the frames"
        )
    return [
        (drop + float(up @ one.T), one.prior.altitude_m, one.prior.altitude_sigma_m or np.nan)
        for one in told
        if one.prior.altitude_m is not None
    ]


def with_source(report: Report, given: Options, used: list[FrameState]) -> Report:
    """The report with what its unit of length comes from, where that is what is known of the frames."""
    if report.scale.source != "baseline" or given.baseline_m is not None:
        return report
    source: Literal["pose", "altitude"] = "pose" if _moves(_seen(used)) else "altitude"
    return replace(report, scale=replace(report.scale, source=source))


def turn_known(first: FramePrior | None, other: FramePrior | None) -> tuple[FloatArray, float] | None:
    """Rotation from the axes of one frame to those of another by their attitudes, and its 1-sigma, rad; or None."""
    if first is None or other is None or first.ned is None or other.ned is None:
        return None
    if not (first.heading and other.heading and first.attitude_sigma_deg and other.attitude_sigma_deg):
        return None
    sigma = float(np.radians(np.hypot(first.attitude_sigma_deg, other.attitude_sigma_deg)))
    return other.ned.T @ first.ned, sigma


def prior_notes(used: list[FrameState]) -> list[Diagnostic]:
    """Warn where the images turn otherwise than the attitudes say, and where these contradict each other."""
    seen = _seen(used)
    turn = _turned_otherwise(seen)
    means = [_disputed(what, mean) for what, mean in (("up", _up(seen)), ("north", _north(seen))) if mean]
    return [
        finding("metadata-contradicted", *said, f"{REMEDY}, and attitude_sigma_deg") for said in (turn, *means) if said
    ]


def _disputed(what: str, mean: _Mean) -> tuple[str, float] | None:
    """That frames contradict each other in what is up, or north, by how much, and what was made of it; or None."""
    if not mean.off_deg:
        return None
    off = f"the angles of frame {mean.frame} in --priors put {what} {mean.off_deg:.0f}° off "
    if mean.left_out:
        return f"{off}where those of most frames do, and are left out", mean.off_deg
    return f"{off}the mean of all frames, which contradict each other: its sigma is {mean.sigma_deg:.0f}°", mean.off_deg


def _turned_otherwise(seen: list[_Seen]) -> tuple[str, float] | None:
    """That the images turn otherwise than the attitudes say, of the frame that is farthest off, and by how much."""
    first = next((one.prior for one in seen if not one.T.any()), None)
    worst, off, number = 0.0, 0.0, 0
    for one in seen:
        turn = turn_known(first, one.prior)
        if turn is not None:
            apart = float(np.linalg.norm(rotation_vector(one.R @ turn[0].T)))
            if apart / turn[1] > worst:
                worst, off, number = apart / turn[1], float(np.degrees(apart)), one.frame
    if worst <= 2.0 * GATE_SIGMAS:
        return None
    return f"frame {number} is turned against the first by {off:.0f}° more than the angles of --priors say", off
