"""The answer so far: views kept whole, older ones summed up, one or two roots; a new view costs the same every time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import epipolar_distance, essential_matrix, rotation_vector
from slopecli.geometry.solver.many_views import (
    Root,
    ViewsSolution,
    heights_of,
    information_of_relief,
    noise_of,
    off_in_last,
    off_planes,
    refine,
    relief_of,
)
from slopecli.geometry.solver.resection import Motion, resect
from slopecli.geometry.solver.summed_views import sum_up
from slopecli.geometry.solver.view_roots import judged
from slopecli.geometry.solver.views import Summed, ViewPoints, ViewState
from slopecli.geometry.statistics import CHI2
from slopecli.look.matches import ON_PLANE_PX
from slopecli.look.noise import SYSTEMATIC_PX, correlation_gain
from slopecli.patches.windows.tunables import TUNE
from slopecli.sequence.frame_alignment import Found
from slopecli.sequence.fused_planes import Ground, fused_normals
from slopecli.sequence.shared_errors import halves_ratio, neighbours_ratio, noise_alone, off_covariance, tracking_share
from slopecli.sequence.tracking_tunables import TRACKING
from slopecli.sequence.tracks import Tracks
from slopecli.types import BoolArray, FloatArray, IntArray, Solution


@dataclass(frozen=True, eq=False)
class Line:
    """One root with the views that it holds: the points with what older views told, and the minimum."""

    points: ViewPoints
    root: Root


class Held(NamedTuple):
    """The state of a `ViewEstimator`."""

    lines: list[Line]
    alive: BoolArray
    missed: IntArray


class ViewEstimator:
    """Motions of the views and normals of the windows from tracked points, view by view.

    tracks : the points.  focal_px : pixels per unit of normalised coordinate.
    """

    def __init__(self, tracks: Tracks, focal_px: float) -> None:
        self.tracks = tracks
        self._focal_px = focal_px
        self._floor = TUNE.flow_floor_px / focal_px
        self._ground = Ground(tracks)
        self._lines: list[Line] = []
        self.alive = np.ones(len(tracks), bool)
        self._missed = np.zeros(len(tracks), np.int64)
        self._solved: tuple[ViewsSolution, FloatArray] | None = None

    # ---- start ----

    def start(self, found: Found, solution: Solution) -> None:
        """Begin with the first move: where a frame shows the points, and the roots of the pair's solution."""
        kept = found.seen.copy()
        kept[found.seen] = solution.inlier  # a mismatch pulls on all planes through the motion and the noise
        points, other = self._first_points(found, kept), solution.ambiguity.alternative
        self._lines = []
        for one in (solution, other):
            if one is not None:
                u = np.maximum(_plane_depths(points, one.scaled_normals), 1e-9)
                state = ViewState(one.R[None], one.T[None], one.scaled_normals, u, np.zeros(0))
                noise = max(one.noise / found.zoom, self._floor)
                q = information_of_relief(points, one.scaled_normals, one.relief, noise)
                self._lines.append(self._settled(points, state, q, one.relief, noise, rounds=4, most=8))
        self._sort()

    def found_again(self, found: Found, rounds: int) -> None:
        """The first move again, by where its frame shows its points once these are looked for under its planes."""
        used = found.seen & self.alive & (self.best.points.weight[-1] > 0.0)
        weight = (used & self._agreeing(found, used, self.motion))[None] / found.zoom**2
        for k, line in enumerate(self._lines):
            points, root = replace(line.points, x=found.x[None].copy(), weight=weight), line.root
            self._lines[k] = self._settled(points, root.state, root.q, root.relief, root.noise, rounds, most=8)
        self._sort()
        self._solved = None

    def start_from(self, found: Found, R: FloatArray, T: FloatArray, normals: FloatArray, u: FloatArray) -> None:
        """Begin with a motion, |T| = 1, normals (m, 3) and inverse depths (n,) that are roughly known."""
        points, m = self._first_points(found, found.seen), len(normals)
        relief = np.full(m, TRACKING.rough)
        q = information_of_relief(points, normals, relief, self._floor)
        state = ViewState(R[None], T[None], normals, u, np.zeros(0))
        self._lines = [self._settled(points, state, q, relief, self._floor, rounds=1, most=8)]

    def _first_points(self, found: Found, kept: BoolArray) -> ViewPoints:
        """The points, and where the first view shows those that are kept (n,)."""
        weight = (kept & self.alive)[None] / found.zoom**2
        m, n = len(self.tracks.cells), len(self.tracks)
        count = np.bincount(self.tracks.patch[self.tracks.patch >= 0], minlength=m)
        first = np.cumsum(count) - count
        places, nothing = found.x[None].copy(), Summed.nothing(n, m)
        return ViewPoints(self.tracks.p, places, weight, count, first, np.arange(n), nothing)

    @property
    def best(self) -> Line:
        return self._lines[0]

    @property
    def is_open(self) -> bool:
        """Whether two roots are left."""
        return len(self._lines) > 1

    @property
    def motion(self) -> Motion:
        """That of the last view."""
        state = self.best.root.state
        return state.R[-1], state.T[-1]

    @property
    def normals(self) -> FloatArray:
        return self.best.root.state.N

    @property
    def inverse_depth(self) -> FloatArray:
        return self.best.root.state.u

    # ---- one more view ----

    def kept(self) -> Held:
        """What `restored` brings back."""
        return Held(self._lines, self.alive, self._missed)

    def restore(self, held: Held) -> None:
        """Be as when this was kept: a frame that could not be taken in leaves no trace."""
        self._lines, self.alive, self._missed = held
        self._solved = None

    def share_of(self, found: Found, motion: Motion) -> float:
        """Share of the points of a frame that agree with what is known of them."""
        used = found.seen & self.alive
        return float(self._agreeing(found, used, motion)[used].mean()) if used.any() else 0.0

    def add(self, found: Found, motion: Motion) -> None:
        """Take in a view near a motion, and where it shows the points."""
        used = found.seen & self.alive
        agree = self._agreeing(found, used, motion)
        self._missed = np.where(used, np.where(agree, 0, self._missed + 1), self._missed)
        self.alive = self.alive & (self._missed < TRACKING.misses)
        weight = (used & agree) / found.zoom**2
        self._lines = [self._extended(line, found.x, weight, motion) for line in self._lines]
        self._sort()
        self._solved = None

    def decide(self, turn: FloatArray, sigma: float) -> None:
        """Forget a root whose last view a measured turn (3, 3) contradicts, where it agrees with that of the other.

        sigma : 1-sigma of the turn about each axis, rad. By chance a right root is lost less than once in a thousand.
        """
        if not self.is_open:
            return
        off2 = [float(np.sum(rotation_vector(turn @ line.root.state.R[-1].T) ** 2)) / sigma**2 for line in self._lines]
        near = int(np.argmin(off2))
        if max(off2) - off2[near] > CHI2[3, 0.999] > off2[near]:
            self._lines, self._solved = [self._lines[near]], None

    def _extended(self, line: Line, x: FloatArray, weight: FloatArray, motion: Motion) -> Line:
        """A root with one more view, the last one replaced if it was taken from nearly the same place."""
        (points, state), used, root = self._slimmed(line), weight > 0.0, line.root
        if line is not self.best:
            own = (state.R[-1], state.T[-1])
            motion = resect(points.p[:, used], x[:, used], state.u[used], [own], self._floor, 6)[:2]
        R, T = np.concatenate([state.R, motion[0][None]]), np.concatenate([state.T, motion[1][None]])
        points = replace(
            points, x=np.concatenate([points.x, x[None]]), weight=np.concatenate([points.weight, weight[None]])
        )
        state = state._replace(R=R, T=T)
        q = np.where(off_in_last(points, state, root), 0.0, root.q)
        return self._settled(points, state, q, root.relief, root.noise, rounds=1, most=4)

    def _slimmed(self, line: Line) -> tuple[ViewPoints, ViewState]:
        """Points and state without the views that are not to be kept whole."""
        points, root = line.points, line.root
        state = root.state
        if points.n_views > 1 and self._repeats_last(state):
            return _without(points, state, points.n_views - 1)
        most = TRACKING.open_views if self.is_open else TRACKING.kept_views
        if points.n_views < most:
            return points, state
        if self.is_open:  # a view in the middle, as linearising early would decide wrongly
            return _without(points, state, 1 + points.n_views // 2)
        return sum_up(points, state, root.terms, 0, TRACKING.shared_errors)

    def _repeats_last(self, state: ViewState) -> bool:
        """Whether the last view was taken from nearly the same place as the one before it."""
        moved = float(np.linalg.norm(state.T[-1] - state.T[-2]))
        return moved < TRACKING.new_view * float(np.linalg.norm(state.T[-1]))

    def _settled(
        self,
        points: ViewPoints,
        state: ViewState,
        q: FloatArray,
        relief: FloatArray,
        noise: float,
        rounds: int,
        most: int,
    ) -> Line:
        """The minimum, with noise and relief estimated again in every round."""
        for _ in range(rounds):
            state, terms, system, converged, iterations = refine(points, state, q, most=most, tolerance=1e-2)
            noise = max(noise_of(points, terms, system)[0], self._floor)
            heights = heights_of(points, system, state, noise)
            off = off_planes(points, heights)
            relief = relief_of(points, heights, off | ~self.alive)
            q = np.where(off | ~self.alive, 0.0, information_of_relief(points, state.N, relief, noise))
        return Line(points, Root(state, terms, system, relief, q, noise, converged or iterations >= most, iterations))

    def _agreeing(self, found: Found, used: BoolArray, motion: Motion) -> BoolArray:
        """(n,) whether the places found agree with the motion and with what is known of the inverse depths."""
        line, x = self.best, found.x
        u, t = line.root.state.u, line.root.system.t
        R, T = motion
        y = R @ self.tracks.p - (R @ T)[:, None] * u
        seen = y[:2] / np.maximum(y[2], 1e-9)
        slide = (seen * (R @ T)[2] - (R @ T)[:2, None]) / np.maximum(y[2], 1e-9)
        length = np.maximum(np.hypot(*slide), 1e-12)
        along_axis = slide / length
        e = seen - x
        along = np.abs((e * along_axis).sum(axis=0))
        across = np.abs(along_axis[0] * e[1] - along_axis[1] * e[0])
        noise = max(line.root.noise, self._floor) * found.zoom
        sigma = np.median(across[used]) * 1.4826 if used.any() else noise
        sigma = min(max(noise, float(sigma)), max(noise, ON_PLANE_PX / self._focal_px))
        spread = np.hypot(sigma, length * noise * np.sqrt(np.maximum(t, 0.0)))
        return np.asarray((across < 4.5 * sigma) & (along < 4.5 * np.hypot(spread, sigma)))

    # ---- the answer ----

    def _sort(self) -> None:
        """Best root first; a root that is ruled out, or that has become the other one, is forgotten."""
        if len(self._lines) < 2:
            return
        noise = min(line.root.noise for line in self._lines)
        lines = sorted(self._lines, key=lambda line: line.root._replace(noise=noise).cost / noise**2)
        one, other = (line.root.state for line in lines[:2])
        if _is_same(one, other):
            self._lines = lines[:1]
            return
        solution = self._judged(lines)
        self._lines = lines[:1] if solution.status == "resolved" else lines[:2]

    def _judged(self, lines: list[Line]) -> ViewsSolution:
        noise = max(lines[0].root.noise, self._floor)
        gain = self._gain(lines[0])
        roots = [line.root._replace(noise=noise) for line in lines]
        found = judged(lines[0].points, roots, noise * gain, gain)
        # what lens models, interpolation and shading leave may make the wrong one of two fit better, as in a pair
        shown = int(np.count_nonzero(lines[0].points.weight))
        floor = shown * (SYSTEMATIC_PX / (noise * gain * self._focal_px)) ** 2
        if found.status == "resolved" and (found.delta_chi2 or 0.0) < floor:
            found = replace(found, status="unresolved")
        return found

    def _resampled(self, found: ViewsSolution, line: Line) -> ViewsSolution:
        """A solution with the covariance that the points of every window have among themselves, as they show it.

        Two halves of a window's points, alternating like the fields of a chess board, give two planes. If relief
        differed from point to point, they would differ by as much as the solution says; ground that bends smoothly
        makes them differ less, as both halves sample it alike. The part of the noise, which neighbours may share,
        stays.
        """
        ratio = halves_ratio(line.points, line.root, self.tracks.cell)
        scale = min(max(ratio, TRACKING.least_sampling), 1.0)
        by_noise = noise_alone(line.points, line.root)
        relief = found.own_covariance / found.noise_gain**2 - by_noise
        return replace(found, own_covariance=found.noise_gain**2 * by_noise + scale * relief)

    def solution(self) -> ViewsSolution:
        """Motions of the views kept and normals, with covariance and the second root if one is left."""
        return self._answer()[0]

    def with_shared_errors(self, found: ViewsSolution) -> ViewsSolution:
        """A solution of these windows, widened by errors of tracks that neighbours share and by points left out.

        `solution` weighs windows and references against each other without them.
        """
        more, other = self._answer()[1], found.alternative
        if other is not None:
            other = replace(other, own_covariance=other.own_covariance + more)
        return replace(found, own_covariance=found.own_covariance + more, alternative=other)

    def _answer(self) -> tuple[ViewsSolution, FloatArray]:
        """The solution, and what errors of neighbours and points left out add to the (m, 3, 3) of its normals."""
        if self._solved is None:
            line, alone = self.best, self._judged(self._lines)
            found = self._resampled(alone, line)
            ratio = neighbours_ratio(line.points, line.root, self.tracks.cell)
            by_tracks = tracking_share(line.points, line.root)[:, None, None]
            shared = by_tracks * (ratio * alone.own_covariance - found.own_covariance)
            shared = shared + off_covariance(line.points, line.root)
            if (other := found.alternative) is not None:
                other = replace(self._resampled(other, self._lines[1]), scaled_normals=self._fused(self._lines[1]))
            self._solved = replace(found, scaled_normals=self._fused(line), alternative=other), shared
        return self._solved

    def _fused(self, line: Line) -> FloatArray:
        return fused_normals(line.points, line.root, line.root.q > 0.0, self._ground)

    def _gain(self, line: Line) -> float:
        """Factor on standard errors for errors that neighbouring points have in common."""
        points, state = line.points, line.root.state
        used = (points.weight[-1] > 0.0) & (self.tracks.patch >= 0)
        across = epipolar_distance(
            essential_matrix(state.R[-1], state.T[-1]), points.p[:2, used].T, points.x[-1][:, used].T
        )
        patch, cell = self.tracks.patch[used], self.tracks.cell[used]
        return correlation_gain([(cell[patch == i], across[patch == i]) for i in range(points.n_planes)])


def _is_same(one: ViewState, other: ViewState) -> bool:
    """Whether two roots have become one: normals and motions agree to 2e-3 rad."""
    n, o = (N / np.linalg.norm(N, axis=1, keepdims=True) for N in (one.N, other.N))
    turned = np.linalg.norm(one.R - other.R, axis=(1, 2)).max()
    return bool(max(float(np.linalg.norm(n - o, axis=1).max()), float(turned)) < 2e-3)


def _plane_depths(points: ViewPoints, N: FloatArray) -> FloatArray:
    """(n,) inverse depth of its window's plane at every point, of those outside the median."""
    u = np.asarray((points.per_point(N.T) * points.p).sum(axis=0))
    n = points.n_on_planes
    if n < len(u):
        u[n:] = np.median(u[:n])
    return u


def _without(points: ViewPoints, state: ViewState, view: int) -> tuple[ViewPoints, ViewState]:
    """Points and state without one view, which tells nothing then."""
    left = [k for k in range(points.n_views) if k != view]
    slim = replace(points, x=points.x[left], weight=points.weight[left])
    return slim, state._replace(R=state.R[left], T=state.T[left])
