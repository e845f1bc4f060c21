"""Labels by belief propagation: close to the optimum, and with borders where the image has edges."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from slopecli.patches.regions import REGION, BorderCost, cheapest_labels, enlarged


def energy(cost: np.ndarray, labels: np.ndarray, borders: BorderCost) -> float:
    own = np.take_along_axis(cost, labels[..., None], 2).sum()
    across = (borders.left[:, 1:] * (labels[:, 1:] != labels[:, :-1])).sum()
    return float(own + across + (borders.above[1:] * (labels[1:] != labels[:-1])).sum())


def even(shape: tuple[int, int], value: float) -> BorderCost:
    return BorderCost(np.full(shape, value, np.float32), np.full(shape, value, np.float32))


@pytest.mark.parametrize("seed", range(6))
def test_small_grids_are_labelled_almost_optimally(seed: int) -> None:
    cost = np.random.default_rng(seed).uniform(0, 4, (3, 4, 2)).astype(np.float32)
    borders = even((3, 4), 0.8)
    best = min(energy(cost, np.array(p).reshape(3, 4), borders) for p in product(range(2), repeat=12))
    found = energy(cost, cheapest_labels(cost, borders), borders)
    assert found <= 1.03 * best
    assert found <= energy(cost, cost.argmin(2), borders)


def test_noise_is_smoothed_away_and_regions_stay() -> None:
    rng = np.random.default_rng(1)
    truth = np.zeros((40, 50), int)
    truth[10:30, 15:40] = 1
    cost = np.stack([(truth != k) + rng.normal(0, 0.8, truth.shape) for k in range(2)], 2).astype(np.float32)
    assert (cost.argmin(2) != truth).mean() > 0.15
    assert (cheapest_labels(cost, even(truth.shape, 1.0)) != truth).mean() < 0.02


def test_a_border_runs_along_the_edge_of_the_image() -> None:
    gradient = np.zeros((20, 30), np.float32)
    gradient[:, 17] = 10.0
    borders = BorderCost.along_edges(gradient, 1.0)
    assert borders.left[5, 17] == pytest.approx(REGION.border * REGION.border_at_edge, rel=0.01)
    assert borders.left[5, 5] == pytest.approx(REGION.border)
    cost = np.zeros((20, 30, 2), np.float32)
    cost[:, :5, 1], cost[:, 25:, 0] = 9.0, 9.0  # nothing is known in between
    labels = cheapest_labels(cost, borders)
    changes = {int(np.flatnonzero(row[1:] != row[:-1])[0]) + 1 for row in labels}
    assert changes <= {17, 18}


def test_borders_of_blocks_cost_their_whole_length() -> None:
    blocks = even((12, 16), 2.0).of_blocks(4)
    assert blocks.left.shape == (3, 4)
    assert np.allclose(blocks.left, 8.0)


def test_labels_of_blocks_fill_the_image() -> None:
    full = enlarged(np.array([[1, 2], [3, 4]], np.int32), 3, (7, 8))
    assert full.shape == (7, 8)
    assert (full[:3, :3] == 1).all()
    assert (full[3:, 3:] == 4).all()
