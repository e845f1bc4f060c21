"""Energy of assigning points to planes, and labels that nearly minimise it.

E = cost of every point on its plane + a cost for every two neighbours on different planes + a price for every plane
in use, all in nats (negative log probabilities). Label 0 means "on no plane", label k the plane of row k - 1.

Source: PEARL (Isack and Boykov, IJCV 2012) with label costs (Delong et al., IJCV 2012). Departs from them: labels come
from annealed mean-field messages and coordinate descent, not from graph cuts.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from slopecli.types import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array

TEMPERATURES = (4.0, 4.0, 2.0, 2.0, 1.0, 1.0, 0.5, 0.5)  # nats, of successive messages: labels first soft, then decided

AnyFloats = NDArray[np.floating[Any]]  # of either precision


def neighbour_costs(near: IntArray, cost: float) -> csr_array:
    """Return the (n, n) costs of different labels between two points, where either is near the other: near (n, k)."""
    from scipy.sparse import csr_array

    n, k = near.shape
    directed = csr_array((np.full(n * k, cost), (np.repeat(np.arange(n), k), near.ravel())), shape=(n, n))
    return directed.maximum(directed.T)


@dataclass(frozen=True, eq=False)
class Energy:
    """Terms of the energy beside the points' own costs, in nats.

    neighbours : (n, n) symmetric costs of different labels, see `neighbour_costs`.
    none : cost of a point on no plane.  plane : price of a plane in use.
    """

    neighbours: csr_array
    none: float
    plane: float

    def with_none(self, cost: FloatArray) -> FloatArray:
        """Return (n, k + 1) costs of all labels, from the cost (n, k) of every point on every plane."""
        return np.column_stack([np.full(len(cost), self.none), cost])

    def total(self, costs: FloatArray, labels: IntArray) -> float:
        """Return the energy of labels (n,), nats; costs (n, k + 1)."""
        in_use = np.count_nonzero(np.bincount(labels, minlength=1)[1:])
        return float(own_cost(costs, labels).sum()) + self._border(labels) + self.plane * in_use

    def assign(self, costs: FloatArray) -> IntArray:
        """Return labels (n,) that nearly minimise the energy when all planes are in use already."""
        cost = np.minimum(costs - costs.min(axis=1, keepdims=True), 1e6).astype(np.float32)
        neighbours = self.neighbours.astype(np.float32)
        share = _soft(cost, TEMPERATURES[0])
        for temperature in TEMPERATURES:
            share = _soft(cost - neighbours @ share, temperature)
        return self.settle(costs, np.argmax(share, axis=1))

    def settle(self, costs: FloatArray, labels: IntArray) -> IntArray:
        """Return labels after coordinate descent: single points change their label where that lowers the energy.

        Of neighbours only the one with most to gain changes in a sweep, so that two do not swap labels for ever.
        """
        points = np.arange(len(labels))
        row, column = self.neighbours.nonzero()
        for _ in range(10):  # two or three sweeps suffice
            total = costs - self.neighbours @ _one_hot(labels, costs.shape[1])
            best = total.argmin(axis=1)
            gain = total[points, labels] - total[points, best]
            if not (gain > 0).any():
                break
            rank = np.empty(len(labels), np.int64)
            rank[np.argsort(gain, kind="stable")] = points
            moves = gain > 0
            moves[row[rank[row] < rank[column]]] = False
            labels = np.where(moves, best, labels)
        return labels

    def without_plane(self, costs: FloatArray, labels: IntArray, k: int) -> tuple[float, IntArray]:
        """Return by how much the energy grows when label k is given up, and the labels (n,) then.

        Its points take the label that costs least, given their neighbours with other labels.
        """
        own = np.flatnonzero(labels == k)
        total = costs[own] - self.neighbours[own] @ _one_hot(labels, costs.shape[1])
        total[:, k] = np.inf
        after = labels.copy()
        after[own] = total.argmin(axis=1)
        growth = (costs[own, after[own]] - costs[own, k]).sum() + self._border(after) - self._border(labels)
        return float(growth) - self.plane, after

    def between(self, labels: IntArray, i: int, j: int) -> float:
        """Return the cost of all neighbours of which one has label i and the other label j, nats."""
        return float((self.neighbours[labels == i] @ (labels == j)).sum())

    def _border(self, labels: IntArray) -> float:
        graph = self.neighbours
        row = np.repeat(labels, np.diff(graph.indptr))
        return 0.5 * float(graph.data[row != labels[graph.indices]].sum())


def own_cost(costs: FloatArray, labels: IntArray) -> FloatArray:
    """Return the cost (n,) of every point under its label; costs (n, k + 1)."""
    return np.take_along_axis(costs, labels[:, None], axis=1)[:, 0]


def _one_hot(labels: IntArray, n_labels: int) -> FloatArray:
    return np.asarray(labels[:, None] == np.arange(n_labels), float)


def _soft(cost: FloatArray, temperature: float) -> FloatArray:
    weight = np.exp((cost.min(axis=1, keepdims=True) - cost) / np.float32(temperature))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def cover(cost: AnyFloats, current: AnyFloats, price: float) -> IntArray:
    """Return indices of columns of `cost` (n, c) that save more than their price over `current` (n,), best first.

    Each is chosen for what it saves beside those chosen before (greedy facility location). What a column saves only
    falls as others are chosen, so a column whose stale saving is not the largest need not be computed again.
    """
    chosen: list[int] = []
    saves = np.maximum(current[:, None] - cost, 0.0).sum(axis=0)
    fresh = np.ones(len(saves), bool)
    while len(saves) and saves.max() > price:
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
    """Return which planes (n_planes,) have points, and the labels (n,) when only those are kept."""
    from skimage.segmentation import relabel_sequential

    used = np.bincount(labels, minlength=n_planes + 1)[1:] > 0
    return used, np.asarray(relabel_sequential(labels)[0], np.int64)
