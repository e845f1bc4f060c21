"""Which plane every point is on, as the minimum of one energy, whatever a plane's equation may be.

E(labels) = sum of the points' costs + `smooth` for every two neighbours on different planes + `plane_cost` for every
plane in use, all in nats (negative logarithms of probabilities), so that what a plane explains weighs against what
it costs to state it. Label 0 is "on no plane". Source: PEARL (Isack and Boykov, IJCV 2012) with label costs
(Delong et al., IJCV 2012); the labels come from annealed mean-field messages, which NumPy sends all at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from slopecli.types import BoolArray, FloatArray, IntArray

TEMPERATURES = (4.0, 2.0, 1.0, 0.5, 0.25)  # nats: neighbours first lean on each other, then decide
ROUNDS = 8  # of choosing, assigning and refitting: labels rarely change after five


@dataclass(frozen=True, eq=False)
class Graph:
    """Who is next to whom: neighbour (n, m) indices, weight (n, m), 0 where a point has fewer than m neighbours.

    The relation is mutual, and its weights are what it costs, in nats, that the two are on different planes.
    """

    neighbour: IntArray
    weight: FloatArray

    def agreement(self, share: FloatArray) -> FloatArray:
        """(n, k): how much each point's neighbours are for every label, when `share` (n, k) says how they lean."""
        total = np.zeros_like(share)
        for column, weight in zip(self.neighbour.T, self.weight.T, strict=True):
            total += share[column] * weight[:, None]
        return total

    def disagreement(self, labels: IntArray) -> FloatArray:
        """(n,): what each point pays for neighbours with another label (both ends pay)."""
        return np.asarray((self.weight * (labels[self.neighbour] != labels[:, None])).sum(axis=1))


class PlaneModel(Protocol):
    """The equation of planes: parameters (k, ...) of k planes, and what they say of the n points."""

    def cost(self, planes: FloatArray) -> FloatArray:
        """(n, k) cost of a point on a plane, nats."""

    def refit(self, planes: FloatArray, labels: IntArray) -> FloatArray:
        """The planes, fitted again to the points labelled 1..k."""


@dataclass(frozen=True, eq=False)
class Prices:
    """none: cost of a point on no plane. plane: cost of a plane. Nats."""

    none: float
    plane: float


def label_points(
    model: PlaneModel, candidates: FloatArray, graph: Graph, prices: Prices, sample: IntArray
) -> tuple[IntArray, FloatArray]:
    """Choose planes among the candidates and say which point is on which.

    Parameters
    ----------
    candidates : (c, ...) parameters of proposed planes.  sample : indices of points on which they compete first.

    Returns
    -------
    labels : (n,) -1 for none, else 0..k-1, the plane with most points first.  planes : (k, ...) parameters.
    """
    screen = np.minimum(model.cost(candidates)[sample], prices.none) * (len(graph.neighbour) / len(sample))
    none = prices.none * len(graph.neighbour) / len(sample)
    planes = candidates[_cover(screen, np.full(len(sample), none), prices.plane)]
    labels = np.zeros(len(graph.neighbour), np.int64)
    for _ in range(ROUNDS):
        labels = _assign(_with_none(model.cost(planes), prices), graph)
        planes, labels = _without_dear(model, planes, labels, graph, prices)
        planes = model.refit(planes, labels)
    labels = _assign(_with_none(model.cost(planes), prices), graph)
    return _by_size(labels, planes)


def _with_none(cost: FloatArray, prices: Prices) -> FloatArray:
    return np.column_stack([np.full(len(cost), prices.none), cost])


def _cover(cost: FloatArray, best: FloatArray, price: float) -> list[int]:
    """Indices of columns of `cost` (n, c) that pay for themselves, the one that saves most first."""
    chosen: list[int] = []
    saves = np.maximum(best[:, None] - cost, 0.0).sum(axis=0)
    while True:
        # what a plane saves only falls as others are chosen, so only the front runners need counting again
        front = np.argsort(-saves)[:16]
        saves[front] = np.maximum(best[:, None] - cost[:, front], 0.0).sum(axis=0)
        winner = int(front[np.argmax(saves[front])])
        if saves[winner] < np.max(np.delete(saves, front), initial=0.0):
            continue
        if saves[winner] <= price:
            return chosen
        chosen.append(winner)
        best = np.minimum(best, cost[:, winner])


def _assign(cost: FloatArray, graph: Graph) -> IntArray:
    """Labels (n,) that nearly minimise the energy with all planes (columns of cost (n, k + 1)) in use."""
    share = _soft(cost, TEMPERATURES[0])
    for temperature in TEMPERATURES:
        for _ in range(2):
            share = _soft(cost - graph.agreement(share), temperature)
    return np.asarray(np.argmax(share, axis=1))


def _soft(cost: FloatArray, temperature: float) -> FloatArray:
    weight = np.exp((cost.min(axis=1, keepdims=True) - cost) / temperature)
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def _without_dear(
    model: PlaneModel, planes: FloatArray, labels: IntArray, graph: Graph, prices: Prices
) -> tuple[FloatArray, IntArray]:
    """Drop planes, the dearest first, as long as that lowers the energy."""
    cost = _with_none(model.cost(planes), prices)
    keep = np.ones(cost.shape[1], bool)
    while keep.sum() > 1:
        extra = np.array([_price_of_absence(cost, keep, labels, graph, k) for k in range(1, len(keep))])
        extra[~keep[1:]] = np.inf
        worst = int(np.argmin(extra))
        if extra[worst] > prices.plane:
            break
        keep[worst + 1] = False
        labels = _assign(np.where(keep, cost, 1e6), graph)
    renumber = np.cumsum(keep) - 1
    return planes[keep[1:]], renumber[labels]


def _price_of_absence(cost: FloatArray, keep: BoolArray, labels: IntArray, graph: Graph, k: int) -> float:
    """By how much the energy of points and neighbours grows when plane k's points go to their next best plane."""
    own = np.flatnonzero(labels == k)
    if not len(own):
        return 0.0
    others = keep.copy()
    others[k] = False
    after = labels.copy()
    after[own] = np.flatnonzero(others)[np.argmin(cost[own][:, others], axis=1)]
    change = cost[own, after[own]] - cost[own, k]
    border = graph.disagreement(after).sum() - graph.disagreement(labels).sum()
    return float(change.sum() + 0.5 * border)


def _by_size(labels: IntArray, planes: FloatArray) -> tuple[IntArray, FloatArray]:
    size = np.bincount(labels, minlength=len(planes) + 1)[1:]
    order = np.argsort(-size, kind="stable")
    order = order[size[order] > 0]
    rank = np.full(len(planes) + 1, -1)
    rank[order + 1] = np.arange(len(order))
    return rank[labels], planes[order]
