"""Search for the planes of least energy: propose, assign points, refit, remove, merge, and propose again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from slopecli.patches.labelling.energy import Energy, cover, in_use, own_cost
from slopecli.patches.labelling.labelling_tunables import LABELLING
from slopecli.patches.labelling.student_t import t_cost, t_scale
from slopecli.types import BoolArray, FloatArray, IntArray


class PlaneModel(Protocol):
    """Planes with d parameters, (k, d) for k of them, and the residuals of n points.

    dim : coordinates of a residual, 1 or 2.  base (n,) : cost of a point on any plane at all, nats.
    bounds : smallest and largest scale of the residuals.
    """

    @property
    def dim(self) -> int: ...

    @property
    def base(self) -> FloatArray: ...

    @property
    def bounds(self) -> tuple[float, float]: ...

    def squares(self, planes: FloatArray) -> FloatArray:
        """Return (n, k) squared residuals."""

    def fit(self, plane: FloatArray, own: BoolArray, scale: float) -> FloatArray:
        """Return the plane (d,) refined on its own points, own (n,) bool."""


@dataclass(frozen=True, eq=False)
class State:
    """planes (k, d), the scale of the residuals they share, labels (n,) 0 for none or 1..k, and the energy, nats."""

    planes: FloatArray
    scale: float
    labels: IntArray
    energy: float = np.inf


@dataclass(frozen=True, eq=False)
class Pool:
    """Proposed planes (c, d) and their squared residuals (m, c) on a sample (m,) of the points."""

    planes: FloatArray
    squares: FloatArray
    sample: IntArray

    def cost(self, model: PlaneModel, scale: float, energy: Energy) -> FloatArray:
        """Return (m, c) nats, at most that of a point on no plane, scaled up from the sample to all points."""
        cost = model.base[self.sample, None] + t_cost(self.squares, scale, model.dim)
        return np.asarray(np.minimum(cost, energy.none) * len(model.base) / max(len(self.sample), 1))


def make_pool(model: PlaneModel, planes: FloatArray, place: IntArray, sample: IntArray, none: float) -> Pool:
    """Keep the best of the proposals (c, d) from each place, place (c,) being where each is from.

    The best explains most at any scale of the residuals. Proposals compete with others from their own place only;
    otherwise those of the largest plane would be all that is left.
    """
    squares = model.squares(planes)[sample]
    base = model.base[sample, None]
    saves = np.zeros(len(planes))
    for scale in _scales(model.bounds):
        saves = np.maximum(saves, np.maximum(none - base - t_cost(squares, scale, model.dim), 0.0).sum(axis=0))
    order = np.lexsort((-saves, place))
    best = order[np.unique(place[order], return_index=True)[1]]
    best = best[saves[best] > 0]
    return Pool(planes[best], squares[:, best], sample)


def _scales(bounds: tuple[float, float]) -> list[float]:
    """Return scales from the smallest to the largest, at most a factor of two apart."""
    steps = max(int(np.ceil(np.log2(bounds[1] / bounds[0]))), 1)
    return np.geomspace(*bounds, steps + 1).tolist()


def search(model: PlaneModel, energy: Energy, pool: Pool, extra: FloatArray | None = None) -> State:
    """Return the planes and labels of lowest energy found, from the pool and `extra` planes (k, d) known beforehand."""
    planes, scale = _first_planes(model, energy, pool)
    if extra is not None:
        planes = np.concatenate([planes, extra])
    best = settled(model, energy, planes, scale)
    for _ in range(6):  # the energy rarely falls after three
        fresh = _further_planes(model, energy, pool, best)
        if not len(fresh):
            break
        state = settled(model, energy, np.concatenate([best.planes, fresh]), best.scale)
        if state.energy >= best.energy:
            break
        best = state
    return best


def _first_planes(model: PlaneModel, energy: Energy, pool: Pool) -> tuple[FloatArray, float]:
    """Return the planes that explain the sample at least energy, and the scale of residuals at which they do."""
    found = []
    for scale in _scales(model.bounds):
        cost = pool.cost(model, scale, energy)
        current = np.full(len(cost), energy.none * len(model.base) / max(len(cost), 1))
        chosen = cover(cost, current, energy.plane * LABELLING.eager)
        # with the first plane, the first two, ...: they are in order of what they save
        total = np.minimum.accumulate(cost[:, chosen], axis=1).sum(axis=0) + energy.plane * np.arange(
            1, len(chosen) + 1
        )
        found.append((float(np.min(total, initial=current.sum())), scale, chosen))
    _, scale, chosen = min(found, key=lambda one: one[0])
    return pool.planes[chosen], scale


def _further_planes(model: PlaneModel, energy: Energy, pool: Pool, state: State) -> FloatArray:
    """Return planes (k, d) of the pool that may be worth having beside those of the state."""
    paid = own_cost(_costs(model, energy, state.planes, state.scale), state.labels)[pool.sample]
    current = np.minimum(paid, energy.none) * len(model.base) / max(len(pool.sample), 1)
    chosen = cover(pool.cost(model, state.scale, energy), current, energy.plane * LABELLING.eager)
    return pool.planes[chosen]


def _costs(model: PlaneModel, energy: Energy, planes: FloatArray, scale: float) -> FloatArray:
    return energy.with_none(model.base[:, None] + t_cost(model.squares(planes), scale, model.dim))


def settled(model: PlaneModel, energy: Energy, planes: FloatArray, scale: float) -> State:
    """Return the planes refitted, with labels that no merger and no removal of a plane would improve."""
    state = State(planes, scale, energy.assign(_costs(model, energy, planes, scale)))
    state = _refitted(model, energy, _refitted(model, energy, state))
    state = _refitted(model, energy, _thinned(model, energy, state))
    state = _refitted(model, energy, _merged(model, energy, state))
    state = _thinned(model, energy, _refitted(model, energy, state))
    costs = _costs(model, energy, state.planes, state.scale)
    return replace(state, energy=energy.total(costs, state.labels))


def _refitted(model: PlaneModel, energy: Energy, state: State) -> State:
    """Fit planes and scale to their points, and assign the points again."""
    state = _in_use(state)
    planes, labels = state.planes, state.labels
    if not len(planes):
        return state
    planes = np.array([model.fit(plane, labels == k + 1, state.scale) for k, plane in enumerate(planes)])
    on = labels > 0
    squares = np.take_along_axis(model.squares(planes), np.maximum(labels - 1, 0)[:, None], axis=1)[on, 0]
    scale = t_scale(squares, model.dim, state.scale, model.bounds)
    return State(planes, scale, energy.settle(_costs(model, energy, planes, scale), labels))


def _in_use(state: State) -> State:
    """Drop the planes that have no points."""
    used, labels = in_use(state.labels, len(state.planes))
    return replace(state, planes=state.planes[used], labels=labels)


def _thinned(model: PlaneModel, energy: Energy, state: State) -> State:
    """Remove planes, the least useful first, as long as that lowers the energy."""
    costs, labels = _costs(model, energy, state.planes, state.scale), state.labels
    growth = np.full(len(state.planes) + 1, -np.inf)
    growth[0] = np.inf
    while (k := int(np.argmin(growth))) > 0 and growth[k] < 0:
        # removing one plane makes the others more useful: a growth computed earlier is a lower bound
        fresh, without = energy.without_plane(costs, labels, k)
        if fresh < 0 and fresh <= np.min(np.delete(growth, k)):
            labels, costs[:, k], fresh = without, np.inf, np.inf
        growth[k] = fresh
    return _in_use(replace(state, labels=energy.settle(costs, labels)))


def _merged(model: PlaneModel, energy: Energy, state: State) -> State:
    """Replace pairs of planes by one through the points of both, as long as that lowers the energy."""
    state = _in_use(state)
    while len(state.planes) > 1:
        costs = _costs(model, energy, state.planes, state.scale)
        trials = [_merger(model, energy, state, costs, i, j) for i, j in _likely_mergers(costs, state.labels)]
        saving, i, j, plane = max(trials, key=lambda trial: trial[0])
        if saving <= 0:
            break
        planes = state.planes.copy()
        planes[i - 1] = plane
        costs = _costs(model, energy, planes, state.scale)
        costs[:, j] = np.inf
        labels = energy.settle(costs, np.where(state.labels == j, i, state.labels))
        state = _in_use(State(planes, state.scale, labels))
    return state


def _likely_mergers(costs: FloatArray, labels: IntArray) -> list[tuple[int, int]]:
    """Return the pairs (i, j) of labels whose merger costs plane j's points least, if plane i explains them."""
    k = costs.shape[1] - 1
    loss = np.full((k, k), np.inf)
    for j in range(k):
        own = costs[labels == j + 1]
        loss[:, j] = np.median(own[:, 1:], axis=0) - np.median(own[:, j + 1])
        loss[j, j] = np.inf
    order = np.argsort(loss, axis=None, kind="stable")[: min(2 * k, k * (k - 1))]
    return [(int(at) // k + 1, int(at) % k + 1) for at in order]


def _merger(
    model: PlaneModel, energy: Energy, state: State, costs: FloatArray, i: int, j: int
) -> tuple[float, int, int, FloatArray]:
    """Return what one plane for the points of i and j would save, nats, with i, j and that plane."""
    both = (state.labels == i) | (state.labels == j)
    plane = model.fit(state.planes[i - 1], both, state.scale)
    cost = model.base[both] + t_cost(model.squares(plane[None])[both, 0], state.scale, model.dim)
    grows = np.minimum(cost, energy.none).sum() - own_cost(costs, state.labels)[both].sum()
    return float(energy.plane + energy.between(state.labels, i, j) - grows), i, j, plane
