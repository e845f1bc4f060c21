"""The joint solution with one parameter of both cameras free as well: steps along it, then Gauss-Newton.

Gauss-Newton alone sticks when a focal length is off by a third. So the focal length is first moved by steps of its
logarithm to either side, all else solved again from the neighbouring step, and the best step is refined. And a wrong
camera may have led to a motion far from the right one, from which no step comes back: where the focal length and the
motion that epipolar lines tell explain the points clearly better, the search begins there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from slopecli.errors import DegenerateConfiguration, SlopemapError
from slopecli.geometry.epipolar import rotation_from_vector
from slopecli.geometry.solver.focal_start import Motion, Start, gain_by_lines, start_by_lines
from slopecli.geometry.solver.intrinsics import PARAMETERS, CameraScore, Settled, score_camera, with_planes
from slopecli.geometry.solver.observations import (
    FINEST_RESIDUAL,
    Observations,
    QuadraticForm,
    linearise,
    observe,
    predict,
)
from slopecli.geometry.solver.one_thread import one_blas_thread
from slopecli.geometry.solver.refinement import State, levenberg_marquardt
from slopecli.geometry.solver.relief import estimate_relief
from slopecli.geometry.solver.seen_points import Sightings, changed, thinned
from slopecli.geometry.solver.solve import solve_from
from slopecli.types import FloatArray, Solution

FOCAL_STEPS = (0.1, 0.2, 0.35, 0.5, 0.7)  # of the logarithm of the focal length, to either side
ENOUGH_FOR_STEPS = 1000  # points by which steps are compared; what they find is refined with all
MOST_RISES = 2  # of the cost in a row, after which steps to one side end
LONGEST_STEP = {"f": 0.3, "cx": 0.1, "cy": 0.1, "k1": 0.2}  # of Gauss-Newton, in the units of `intrinsics.changed`


class _FocalSearch(NamedTuple):
    """When a search begins where epipolar lines say, and how long it goes on."""

    points: int = 1500  # by which the lines are fitted: fewer miss them where mismatches are many
    least: float = 0.05  # logarithm of a focal length from which on it is another; Gauss-Newton finds nearer ones
    gain: float = 0.1  # of the mean cost of a point, as by 10 % less noise: right cameras come to 0.085
    mismatch_px: float = 10.0  # reach of mismatches: a few px where others guided the search, more in the overview
    rounds: int = 8  # of choosing the points anew


_FOCAL_SEARCH = _FocalSearch()


class Freed(NamedTuple):
    """The best value of one parameter of both cameras, as of `intrinsics.changed`, and the solution under it.

    cost : twice the negative logarithm of the likelihood, less a constant.  score : of the changed cameras.
    less_noise : noise of the solution under the value given over that under this one, each of the points that fit it.
    """

    value: float
    settled: Settled
    cost: float
    score: CameraScore
    less_noise: float


class _Tried(NamedTuple):
    """A value of a parameter, the solution under it, its cost, and the points as cameras with that value see them."""

    value: float
    settled: Settled
    cost: float
    seen: Sightings


@one_blas_thread()
def free_parameter(sightings: Sightings, start: Settled, parameter: str, steps: bool = True) -> Freed | None:
    """Motion, normals and one of `PARAMETERS` that fit the sightings best; None where no value fits.

    start : the solution under the cameras of the sightings.  steps : whether a focal length may be far off.
    """
    best = _settle(sightings, parameter, 0.0, start)
    if best is None:
        return None
    if parameter == "f" and steps:
        best = _stepped(sightings, best)
    return _gauss_newton(sightings, parameter, best)


class ByLines(NamedTuple):
    """What epipolar lines alone say of the focal length: a start of the search, see `start_by_lines`, or None."""

    start: Start | None

    @property
    def elsewhere(self) -> bool:
        """Whether it is another focal length than the one given, farther off than Gauss-Newton finds."""
        return self.start is not None and abs(self.start[0]) >= _FOCAL_SEARCH.least

    @property
    def near(self) -> bool:
        """Whether it is about the one given, so that Gauss-Newton finds it."""
        return self.start is not None and not self.elsewhere


def focal_by_lines(every: Sightings, noise: float) -> ByLines:
    """The focal length by epipolar lines of all points, mismatches included; noise: of the matches, normalised."""
    return ByLines(start_by_lines(thinned(every, _FOCAL_SEARCH.points), noise, FOCAL_STEPS[-1]))


def lines_explain(every: Sightings, of: slice, start: Settled) -> bool:
    """Whether some points miss the epipolar lines of a solution, and lines fitted without any camera clearly less."""
    return gain_by_lines(every, of, (start.R, start.T), start.noise) > _FOCAL_SEARCH.gain


def free_focal_nearby(sightings: Sightings, start: Settled) -> Freed | None:
    """The logarithm of the focal length that fits best within reach of Gauss-Newton, by a share of the points.

    start : the solution under the cameras of the sightings.
    """
    some = thinned(sightings, ENOUGH_FOR_STEPS, sightings.gain)
    return free_parameter(*with_planes(some, start), "f", steps=False)


def free_focal(
    every: Sightings, start: Settled, far: Callable[[Freed], bool] | None = None, lines: ByLines | None = None
) -> Freed | None:
    """The logarithm of the focal length over that of the cameras that fits best, solved again with its own mismatches.

    What was kept under a wrong focal length was chosen to fit it. So the points that fit are chosen again under the
    one found, until it stays.

    every : all points, mismatches included.  start : the solution under the cameras given.  far : whether the first
    value found is worth a second look; None for any.  lines : what `focal_by_lines` found, if it is known.
    """
    given = _solved(every, 0.0, (start.R, start.T))
    if given is None:
        return None
    lines = lines or focal_by_lines(every, given.solution.noise)
    last = _from_epipolar_lines(every, given, lines)
    for number in range(_FOCAL_SEARCH.rounds):
        first = not number and last is given
        freed = _freed_again(every, last, steps=first and not lines.near)
        if freed is None:
            return None
        stays = abs(freed.value - last.value) < max(0.001, 0.3 * float(freed.score.sigma[0]))
        if stays or (first and far and not far(freed)):
            break
        again = _solved(every, freed.value, (freed.settled.R, freed.settled.T))
        if again is None:
            break
        last = again
    return freed and freed._replace(less_noise=given.noise_px / max(last.noise_px, FINEST_RESIDUAL))


def _freed_again(every: Sightings, last: _Solved, steps: bool) -> Freed | None:
    """The value that fits the points which fit `last`; None where there is none, or beyond the values tried, unless
    residuals change by more than their noise with it: a focal length that the points leave open grows without end."""
    kept = thinned(last.left.take(last.solution.inlier), gain=every.gain)
    freed = free_parameter(*with_planes(kept, Settled.of(last.solution)), "f", steps=steps)
    if freed is None:
        return None
    beyond, held = abs(last.value + freed.value) / FOCAL_STEPS[-1], freed.score.px[0] > freed.score.noise_px
    if beyond > (2.0 if held else 1.0):
        return None
    return freed._replace(value=last.value + freed.value)


class _Solved(NamedTuple):
    """All points as seen with a logarithm of the focal length, and their solution with mismatches of its own."""

    value: float
    left: Sightings
    solution: Solution

    @property
    def noise_px(self) -> float:
        """1-sigma of the points that fit, px of image 2."""
        return self.solution.noise * self.left.cameras[1].focal_px

    @property
    def cost(self) -> float:
        """Mean negative log likelihood of the points, less a constant; a mismatch is anywhere within its reach."""
        fit = float(self.solution.inlier.mean())
        floor = FINEST_RESIDUAL * self.left.cameras[1].focal_px
        return fit * math.log(max(self.noise_px, floor)) + (1.0 - fit) * math.log(_FOCAL_SEARCH.mismatch_px)


def _solved(every: Sightings, value: float, start: Motion) -> _Solved | None:
    left = _changed(every, "f", value).with_rays() if value else every
    try:
        solution = solve_from(start, *left.rays(), left.patch, left.weight)
    except (SlopemapError, np.linalg.LinAlgError):
        return None
    return _Solved(value, left, solution)


def _from_epipolar_lines(every: Sightings, given: _Solved, lines: ByLines) -> _Solved:
    """The solution from where epipolar lines say, where it explains the points clearly better; else that given."""
    solved = _solved(every, *lines.start) if lines.start and lines.elsewhere else None
    return solved if solved and solved.cost < given.cost - _FOCAL_SEARCH.gain else given


def _stepped(sightings: Sightings, middle: _Tried) -> _Tried:
    """The best of a solution and those at steps of the focal length, which are compared by a share of the points."""
    some = thinned(sightings, ENOUGH_FOR_STEPS)
    start = _settle(some, "f", middle.value, middle.settled)
    if start is None:
        return middle
    best = min([start, *_either_side(some, start)], key=lambda one: one.cost)
    tried = None if best is start else _settle(sightings, "f", best.value, best.settled)
    return middle if tried is None or tried.cost > middle.cost else tried


def _either_side(sightings: Sightings, middle: _Tried) -> list[_Tried]:
    """The solutions at all steps of the focal length, each from its neighbour nearer to the start."""
    found = []
    for side in (-1.0, 1.0):
        last, rises = middle, 0
        for size in FOCAL_STEPS:
            moved = _refocused(last.settled, side * size - last.value)
            tried = _settle(sightings, "f", side * size, moved)
            if tried is None:
                break
            rises = rises + 1 if tried.cost > last.cost else 0
            last = tried
            found.append(last)
            if rises == MOST_RISES:
                break
    return found


def _gauss_newton(sightings: Sightings, parameter: str, best: _Tried) -> Freed:
    """Refine a value with all else; steps that fit worse are halved."""
    index = PARAMETERS.index(parameter)
    score = score_camera(best.seen, best.settled)
    for _ in range(12):
        step, sigma = float(score.step[index]), float(score.sigma[index])
        if abs(step) <= max(0.1 * sigma, 1e-10):  # far less than it is known to
            break
        step = float(np.clip(step, -LONGEST_STEP[parameter], LONGEST_STEP[parameter]))
        for size in (1.0, 0.5, 0.2):
            moved = _refocused(best.settled, size * step) if parameter == "f" else best.settled
            tried = _settle(sightings, parameter, best.value + size * step, moved)
            # a step within the noise is taken as it is: the cost is flat there
            if tried is not None and (tried.cost < best.cost or abs(step) < sigma):
                break
        else:
            break
        best, score = tried, score_camera(tried.seen, tried.settled)
    return Freed(best.value, best.settled, best.cost, score, 1.0)


def _changed(sightings: Sightings, parameter: str, value: float) -> Sightings:
    first, second = (changed(camera, parameter, value) for camera in sightings.cameras)
    return sightings.seen_by((first, second))


def _refocused(settled: Settled, by: float) -> Settled:
    """Motion and planes whose images are nearly those of `settled`, for a focal length exp(by) times as long.

    Rays are exp(by) times nearer to the axis then: sideways parts of the baseline and of turns are less, slopes more.
    """
    shrink = float(np.exp(-by))
    axis = settled.R[:, 2]
    aim = axis * [shrink, shrink, 1.0]
    turn = np.cross(axis, aim / np.linalg.norm(aim))
    sine = float(np.linalg.norm(turn))
    if sine > 0.0:
        turn *= np.arcsin(min(sine, 1.0)) / sine
    T = settled.T * [shrink, shrink, 1.0]
    length = float(np.linalg.norm(T))
    normals = settled.scaled_normals * [1.0 / shrink, 1.0 / shrink, 1.0] * length
    return settled._replace(R=rotation_from_vector(turn) @ settled.R, T=T / length, scaled_normals=normals)


def _settle(sightings: Sightings, parameter: str, value: float, start: Settled) -> _Tried | None:
    """The solution under cameras with a given value of a parameter; None where it is beyond what they can see."""
    seen_by = _changed(sightings, parameter, value) if value else sightings
    x1, x2 = seen_by.rays()
    if not (np.isfinite(x1).all() and np.isfinite(x2).all()):
        return None
    try:
        seen = observe(x1, x2, sightings.patch, sightings.weight)
    except DegenerateConfiguration:
        return None
    state = State(start.R[None], start.T[None], start.scaled_normals[None])
    relief = estimate_relief(seen, predict(seen, *state), 0, start.noise, False, settled=True)
    for _ in range(3):
        form = partial(_form, seen, relief.W[None])
        refined = levenberg_marquardt(state, form, max(seen.freedom(), 1), max_iterations=20)
        state, before = refined.state, relief
        relief = estimate_relief(seen, predict(seen, *state), 0, None, False)
        if abs(relief.noise - before.noise) < 0.01 * relief.noise:
            break
    noise_px = relief.noise * seen_by.cameras[1].focal_px
    rows = 2 * len(seen.weight) + seen.n_free
    chi2 = float(linearise(seen, predict(seen, *state), relief.W[None]).constant[0]) / relief.noise**2
    cost = 2.0 * rows * float(np.log(noise_px)) + relief.log_determinant + chi2
    settled = Settled(state.R[0], state.T[0], state.N[0], relief.noise, relief.relative)
    return _Tried(value, settled, cost, replace(seen_by, known=(x1, x2))) if np.isfinite(cost) else None


def _form(seen: Observations, W: FloatArray, state: State) -> QuadraticForm:
    return linearise(seen, predict(seen, *state), W)
