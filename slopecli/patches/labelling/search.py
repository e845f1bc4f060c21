"""The search for the planes that minimise the energy: propose, assign, refit, give up, merge, and propose again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from slopecli.patches.labelling.energy import Energy, cover, in_use
from slopecli.patches.labelling.residual_cost import cost_of, scale_of
from slopecli.types import BoolArray, FloatArray, IntArray

ROUNDS = 6  # of proposing anew: the energy rarely falls after three
PATIENCE = 1  # rounds without a lower energy before the search ends
EAGER = 0.3  # of a plane's price: planes that save this much are tried, as two may be worth what neither is alone
MOST_NEW = 12  # planes tried at once
FINER = 0.7  # by which the scale is made smaller after a round in vain: what is one plane may be two close ones
MERGES_TRIED = 2  # pairs for every plane, those that lose least by the other's equation
WIDE = 10.0  # scales: so that a plane for two is drawn to the points of both
LADDER = 2.0  # ratio of the scales of noise that are tried first


class PlaneModel(Protocol):
    """The equation of planes: parameters (k, d) of k planes, and what the n points say of them.

    dim: coordinates of a residual, 1 or 2.  base (n,): cost of a point on any plane at all, nats.
    bounds: smallest and largest scale of the noise.
    """

    @property
    def dim(self) -> int: ...

    @property
    def base(self) -> FloatArray: ...

    @property
    def bounds(self) -> tuple[float, float]: ...

    def squares(self, planes: FloatArray) -> FloatArray:
        """(n, k) squared residuals."""

    def fit(self, plane: FloatArray, own: BoolArray, scale: float) -> FloatArray:
        """The plane (d,) refined on its own points (n,)."""


@dataclass(frozen=True, eq=False)
class State:
    """planes (k, d), the scale of the noise they share, labels (n,) 0 for none or 1..k, and the energy, nats."""

    planes: FloatArray
    scale: float
    labels: IntArray
    energy: float


@dataclass(frozen=True, eq=False)
class Pool:
    """Proposed planes (c, d) and their squared residuals (m, c) on a sample (m,) of the points."""

    planes: FloatArray
    squares: FloatArray
    sample: IntArray

    def cost(self, model: PlaneModel, scale: float, none: float) -> FloatArray:
        """(m, c) nats, no more than that of a point on no plane."""
        return np.minimum(model.base[self.sample, None] + cost_of(self.squares, scale, model.dim), none)


def make_pool(model: PlaneModel, planes: FloatArray, place: IntArray, sample: IntArray, none: float) -> Pool:
    """Of the proposals (c, d) from each place, place (c,), the one that explains most, at whatever scale of noise.

    A proposal competes with others from its own place only, or those of the largest plane would be all there are.
    """
    squares = model.squares(planes)[sample]
    base = model.base[sample, None]
    saves = np.zeros(len(planes))
    for scale in ladder(model.bounds):
        cost = base + cost_of(squares, float(scale), model.dim)
        saves = np.maximum(saves, np.maximum(none - cost, 0.0).sum(axis=0))
    order = np.lexsort((-saves, place))
    best = order[np.unique(place[order], return_index=True)[1]]
    best = best[saves[best] > 0]
    return Pool(planes[best], squares[:, best], sample)


def ladder(bounds: tuple[float, float]) -> FloatArray:
    """Scales from the smallest to the largest believed, a factor apart."""
    steps = max(int(np.ceil(np.log(bounds[1] / bounds[0]) / np.log(LADDER))), 1)
    return np.asarray(np.geomspace(bounds[0], bounds[1], steps + 1))


def search(model: PlaneModel, energy: Energy, pool: Pool, extra: FloatArray | None = None) -> State:
    """The planes and labels of lowest energy found, from the pool and `extra` planes (k, d) known beforehand."""
    planes, scale = _first_guess(model, energy, pool)
    if extra is not None:
        planes = np.concatenate([planes, extra])
    best = settled(model, energy, planes, scale)
    vain = 0
    for _ in range(ROUNDS):
        fresh = _proposals(model, energy, pool, best, FINER**vain)
        if not len(fresh):
            break
        state = settled(model, energy, np.concatenate([best.planes, fresh]), best.scale)
        vain = 0 if state.energy < best.energy else vain + 1
        best = state if state.energy < best.energy else best
        if vain > PATIENCE:
            break
    return best


def _first_guess(model: PlaneModel, energy: Energy, pool: Pool) -> tuple[FloatArray, float]:
    """Planes that cover the sample most cheaply, and the scale of noise at which that is so."""
    factor = len(energy.graph) / max(len(pool.sample), 1)
    current = np.full(len(pool.sample), energy.none * factor)
    guesses = []
    for scale in ladder(model.bounds):
        cost = pool.cost(model, float(scale), energy.none) * factor
        chosen = cover(cost, current, energy.plane * EAGER)
        # with the first plane, the first two, ...: they are in order of what they save
        paid = np.minimum.accumulate(cost[:, chosen], axis=1).sum(axis=0) + energy.plane * np.arange(1, len(chosen) + 1)
        guesses.append((float(np.min(paid, initial=current.sum())), float(scale), chosen))
    _, scale, chosen = min(guesses, key=lambda guess: guess[0])
    return pool.planes[chosen], scale


def _proposals(model: PlaneModel, energy: Energy, pool: Pool, state: State, finer: float) -> FloatArray:
    """(k, d) planes of the pool that may be worth having beside those of `state`."""
    factor = len(energy.graph) / max(len(pool.sample), 1)
    paid = _point_cost(_columns(model, energy, state.planes, state.scale), state.labels)[pool.sample]
    scale = max(state.scale * finer, model.bounds[0])
    cost = pool.cost(model, scale, energy.none) * factor
    chosen = cover(cost, np.minimum(paid, energy.none) * factor, energy.plane * EAGER)
    return pool.planes[chosen[:MOST_NEW]]


def _columns(model: PlaneModel, energy: Energy, planes: FloatArray, scale: float) -> FloatArray:
    return energy.columns(model.base[:, None] + cost_of(model.squares(planes), scale, model.dim))


def _point_cost(columns: FloatArray, labels: IntArray) -> FloatArray:
    return np.take_along_axis(columns, labels[:, None], axis=1)[:, 0]


def settled(model: PlaneModel, energy: Energy, planes: FloatArray, scale: float) -> State:
    """From planes to a labelling that no merger, no refit and no plane less would better."""
    state = State(planes, scale, energy.assign(_columns(model, energy, planes, scale)), np.inf)
    state = _refitted(model, energy, _refitted(model, energy, state))
    state = _refitted(model, energy, _thinned(model, energy, state))
    state = _refitted(model, energy, _merged(model, energy, state))
    state = _thinned(model, energy, _refitted(model, energy, state))
    columns = _columns(model, energy, state.planes, state.scale)
    return replace(state, energy=energy.of(columns, state.labels))


def _refitted(model: PlaneModel, energy: Energy, state: State) -> State:
    """Planes and scale fitted to their points, and the points settled anew."""
    used, labels = in_use(state.labels, len(state.planes))
    planes = state.planes[used]
    if not len(planes):
        return replace(state, planes=planes, labels=labels)
    planes = np.array([model.fit(plane, labels == k + 1, state.scale) for k, plane in enumerate(planes)])
    on = labels > 0
    squares = np.take_along_axis(model.squares(planes), np.maximum(labels - 1, 0)[:, None], axis=1)[on, 0]
    scale = scale_of(squares, model.dim, state.scale, model.bounds)
    labels = energy.settle(_columns(model, energy, planes, scale), labels)
    return State(planes, scale, labels, np.inf)


def _thinned(model: PlaneModel, energy: Energy, state: State) -> State:
    """Planes given up, the dearest first, as long as that lowers the energy."""
    columns, labels = _columns(model, energy, state.planes, state.scale), state.labels
    growth = np.full(len(state.planes) + 1, -np.inf)
    growth[0] = np.inf
    while (dearest := int(np.argmin(growth))) > 0 and growth[dearest] < 0:
        # giving up one plane makes the others harder to spare: a growth counted before is a lower bound
        fresh, without = energy.price_of_absence(columns, labels, dearest)
        if fresh < 0 and fresh <= np.min(np.delete(growth, dearest)):
            labels, columns[:, dearest], fresh = without, np.inf, np.inf
        growth[dearest] = fresh
    labels = energy.settle(columns, labels)
    return _kept(replace(state, labels=labels))


def _kept(state: State) -> State:
    """Without the planes that have no points."""
    used, labels = in_use(state.labels, len(state.planes))
    return replace(state, planes=state.planes[used], labels=labels)


def _merged(model: PlaneModel, energy: Energy, state: State) -> State:
    """Pairs of planes replaced by one through the points of both, as long as that lowers the energy."""
    state = _kept(state)
    while len(state.planes) > 1:
        columns = _columns(model, energy, state.planes, state.scale)
        trials = [_merger(model, energy, state, columns, i, j) for i, j in _likely_mergers(columns, state.labels)]
        saving, i, j, plane = max(trials, key=lambda trial: trial[0])
        if saving <= 0:
            break
        planes = state.planes.copy()
        planes[i - 1] = plane
        columns = _columns(model, energy, planes, state.scale)
        columns[:, j] = np.inf
        labels = energy.settle(columns, np.where(state.labels == j, i, state.labels))
        state = _kept(State(planes, state.scale, labels, np.inf))
    return state


def _likely_mergers(columns: FloatArray, labels: IntArray) -> list[tuple[int, int]]:
    """Pairs (i, j) of labels such that plane j's points lose least, each, when plane i has to explain them too."""
    k = columns.shape[1] - 1
    loss = np.full((k, k), np.inf)
    for j in range(k):
        own = columns[labels == j + 1]
        loss[:, j] = np.median(own[:, 1:], axis=0) - np.median(own[:, j + 1])
        loss[j, j] = np.inf
    order = np.argsort(loss, axis=None, kind="stable")[: min(MERGES_TRIED * k, k * (k - 1))]
    return [(int(at) // k + 1, int(at) % k + 1) for at in order]


def _merger(
    model: PlaneModel, energy: Energy, state: State, columns: FloatArray, i: int, j: int
) -> tuple[float, int, int, FloatArray]:
    """What one plane for the points of i and j would save, nats, and that plane."""
    both = (state.labels == i) | (state.labels == j)
    plane = state.planes[i - 1]
    for scale in (WIDE * state.scale, state.scale):
        plane = model.fit(plane, both, scale)
    cost = model.base[both] + cost_of(model.squares(plane[None])[both, 0], state.scale, model.dim)
    grows = np.minimum(cost, energy.none).sum() - _point_cost(columns, state.labels)[both].sum()
    apart = (state.labels == i)[:, None] & (state.labels[energy.graph.neighbour] == j)
    return float(energy.plane + energy.graph.weight[apart].sum() - grows), i, j, plane
