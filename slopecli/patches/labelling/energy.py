"""Which plane every point is on, as the minimum of one energy, whatever a plane's equation may be.

E = sum of the points' costs + a cost for every two neighbours on different planes + a price for every plane in use.
All are in nats, negative logarithms of probabilities, so that what a plane explains weighs against what it takes to
state it. Column 0 and label 0 stand for "on no plane". Source: PEARL (Isack and Boykov, IJCV 2012) with label costs
(Delong et al., IJCV 2012). Departs from them: the labels come from annealed mean-field messages, which NumPy sends
all at once, and are then settled one by one; a cut of the graph is not needed where most points know their plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopecli.types import BoolArray, FloatArray, IntArray

TEMPERATURES = (4.0, 2.0, 1.0, 0.5)  # nats: neighbours first lean on each other, then decide
MESSAGES = 2  # at each temperature
SWEEPS = 10  # of settling, at most: two or three change anything

AnyFloats = NDArray[np.floating[Any]]  # of either precision


@dataclass(frozen=True, eq=False)
class Graph:
    """Who is next to whom: neighbour (n, m) indices, weight (n, m), 0 where a point has fewer than m neighbours.

    The relation is mutual; a weight is what it costs, in nats, that the two are on different planes.
    """

    neighbour: IntArray
    weight: FloatArray

    def __len__(self) -> int:
        return len(self.neighbour)

    def leaning(self, share: FloatArray) -> FloatArray:
        """(n, k): the weight of each point's neighbours for every label, when `share` (n, k) says how they lean."""
        total = np.zeros_like(share)
        for column, weight in zip(self.neighbour.T, self.weight.T, strict=True):
            total += share[column] * weight[:, None].astype(share.dtype)
        return total

    def votes(self, labels: IntArray, n_labels: int) -> FloatArray:
        """(n, n_labels): the weight of each point's neighbours that have each label."""
        place = labels[self.neighbour] + np.arange(len(self))[:, None] * n_labels
        count = np.bincount(place.ravel(), self.weight.ravel(), len(self) * n_labels)
        return np.asarray(count.reshape(len(self), n_labels))

    def border(self, labels: IntArray) -> float:
        """The cost of all neighbours with different labels, nats."""
        return 0.5 * float(self.weight[labels[self.neighbour] != labels[:, None]].sum())


@dataclass(frozen=True, eq=False)
class Energy:
    """none: the cost of a point on no plane. plane: the price of a plane. Both in nats."""

    graph: Graph
    none: float
    plane: float

    def columns(self, cost: FloatArray) -> FloatArray:
        """(n, k + 1): the cost of every label, from the cost (n, k) on every plane."""
        return np.column_stack([np.full(len(cost), self.none), cost])

    def of(self, columns: FloatArray, labels: IntArray) -> float:
        """The energy of a labelling, nats."""
        paid = np.take_along_axis(columns, labels[:, None], axis=1).sum()
        in_use = np.count_nonzero(np.bincount(labels, minlength=1)[1:])
        return float(paid) + self.graph.border(labels) + self.plane * in_use

    def assign(self, columns: FloatArray) -> IntArray:
        """(n,) labels that nearly minimise the energy, all planes being stated already."""
        cost = np.minimum(columns - columns.min(axis=1, keepdims=True), 1e6).astype(np.float32)
        share = _soft(cost, TEMPERATURES[0])
        for temperature in TEMPERATURES:
            for _ in range(MESSAGES):
                share = _soft(cost - self.graph.leaning(share), temperature)
        return self.settle(columns, np.argmax(share, axis=1))

    def settle(self, columns: FloatArray, labels: IntArray) -> IntArray:
        """Let points change their labels one after another as long as that lowers the energy.

        Two neighbours never move in one sweep, or they might change places for ever.
        """
        points = np.arange(len(labels))
        for _ in range(SWEEPS):
            total = columns - self.graph.votes(labels, columns.shape[1])
            best = total.argmin(axis=1)
            gain = total[points, labels] - total[points, best]
            if not (gain > 0).any():
                break
            rank = np.empty(len(labels), np.int64)
            rank[np.argsort(gain, kind="stable")] = points
            first = ((rank[self.graph.neighbour] < rank[:, None]) | (self.graph.weight == 0)).all(axis=1)
            labels = np.where((gain > 0) & first, best, labels)
        return labels

    def price_of_absence(self, columns: FloatArray, labels: IntArray, k: int) -> tuple[float, IntArray]:
        """By how much the energy grows when plane k is given up, and the labels (n,) then.

        Its points go where they cost least, given their neighbours on other planes.
        """
        own = np.flatnonzero(labels == k)
        near, weight = self.graph.neighbour[own], self.graph.weight[own]
        total = columns[own].copy()
        np.add.at(total, (np.arange(len(own))[:, None], labels[near]), -weight)
        total[:, k] = np.inf
        after = labels.copy()
        after[own] = total.argmin(axis=1)
        parted = weight * (after[near] != after[own][:, None])
        mates = labels[near] == k  # seen from both ends
        border = (np.where(mates, 0.5, 1.0) * parted).sum() - weight[~mates].sum()
        growth = (columns[own, after[own]] - columns[own, k]).sum() + border
        return float(growth) - self.plane, after


def _soft(cost: FloatArray, temperature: float) -> FloatArray:
    weight = np.exp((cost.min(axis=1, keepdims=True) - cost) / np.float32(temperature))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def cover(cost: AnyFloats, current: AnyFloats, price: float) -> IntArray:
    """Indices of columns of `cost` (n, c) that save more than their price over `current` (n,), best first.

    Each is chosen for what it saves beside those chosen before (the greedy answer to facility location).
    """
    chosen: list[int] = []
    saves = np.maximum(current[:, None] - cost, 0.0).sum(axis=0)
    fresh = np.ones(len(saves), bool)
    while len(saves) and saves.max() > price:
        # what a plane saves only falls as others are chosen: whoever leads with a fresh count has won
        leader = int(np.argmax(saves))
        if not fresh[leader]:
            front = np.argsort(-saves, kind="stable")[:16]
            saves[front] = np.maximum(current[:, None] - cost[:, front], 0.0).sum(axis=0)
            fresh[front] = True
            continue
        chosen.append(leader)
        current = np.minimum(current, cost[:, leader])
        fresh[:] = False
        saves[leader] = 0.0
    return np.array(chosen, np.int64)


def in_use(labels: IntArray, n_planes: int) -> tuple[BoolArray, IntArray]:
    """Which planes (n_planes,) have points, and the labels (n,) when only those are kept."""
    used = np.bincount(labels, minlength=n_planes + 1)[1:] > 0
    number = np.concatenate([[0], np.cumsum(used)])
    return used, np.asarray(number[labels])


def by_size(labels: IntArray, n_planes: int) -> tuple[IntArray, IntArray]:
    """Labels 0 for none, 1..k renumbered to -1 for none, 0.., most points first; and the planes in that order."""
    size = np.bincount(labels, minlength=n_planes + 1)[1:]
    order = np.argsort(-size, kind="stable")[: np.count_nonzero(size)]
    rank = np.full(n_planes + 1, -1)
    rank[order + 1] = np.arange(len(order))
    return np.asarray(rank[labels]), np.asarray(order)
