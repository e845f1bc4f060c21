"""Regions checked against their matches: split at edges, single planes left alone, unmatched surfaces dropped."""

from __future__ import annotations

import numpy as np
import pytest

from slopecli.geometry import homogeneous
from slopecli.look import Labels
from slopecli.patches.regions import REGION, RegionCells, reviewed

SHAPE, CELL, FOCAL = (240, 360), REGION.cell_px, 300.0
SIGMA_PX = 0.08  # of a match
BASELINES_AWAY = 0.1  # inverse depth of the plane x = y = 0
FACING = np.array([0.0, 0.0, BASELINES_AWAY])


def leaning(degrees: float, across: float = 0.0) -> np.ndarray:
    """A plane turned about the image's vertical axis, through the point `across` (normalised x) of FACING."""
    slope = BASELINES_AWAY * np.tan(np.radians(degrees))
    return np.array([slope, 0.0, BASELINES_AWAY - slope * across])


def middles() -> np.ndarray:
    """Row and column (n, 2) of the pixel amid every cell."""
    rows, columns = np.mgrid[0 : SHAPE[0] // CELL, 0 : SHAPE[1] // CELL]
    return np.column_stack([rows.ravel(), columns.ravel()]) * CELL + CELL // 2


def cells_of(planes: list[np.ndarray], number: Labels, seed: int = 0) -> tuple[RegionCells, np.ndarray]:
    """Noisy matches of every cell whose pixel has a number >= 1, on the plane of that number."""
    at = middles()
    at = at[number[tuple(at.T)] > 0]
    uv1 = at[:, ::-1].astype(float)
    x1 = homogeneous((uv1 - [SHAPE[1] / 2, SHAPE[0] / 2]) / FOCAL)
    scale = FOCAL / SIGMA_PX
    truth = np.einsum("ni,ni->n", x1, np.array(planes)[number[tuple(at.T)] - 1])
    noise = np.random.default_rng(seed).normal(size=len(at))
    return RegionCells(uv1, x1 * scale, truth * scale + noise), at


def everywhere(number: int = 1) -> Labels:
    return np.full(SHAPE, number, np.int32)


def review(labels: Labels, cells: RegionCells, at: np.ndarray, least_px: float = 100, seed: int = 0) -> Labels:
    return reviewed(labels, cells, at, least_px, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(10))
def test_one_plane_stays_one(seed: int) -> None:
    cells, at = cells_of([leaning(20)], everywhere(), seed)
    assert (review(everywhere(), cells, at, seed=seed) == 1).all()


@pytest.mark.parametrize("degrees", [25, 60])
def test_a_region_is_split_at_the_edge_between_two_planes(degrees: float) -> None:
    truth = everywhere()
    truth[:, 200:] = 2
    hinge = (200 - SHAPE[1] / 2) / FOCAL
    cells, at = cells_of([FACING, leaning(degrees, hinge)], truth)
    found = review(everywhere(), cells, at)
    assert found.max() == 2
    assert (found[:, :185] == 1).all()
    assert (found[:, 215:] == 2).mean() > 0.99


def test_a_step_between_planes_that_face_one_way_is_left_to_the_finder() -> None:
    truth = everywhere()
    truth[:, 200:] = 2
    cells, at = cells_of([FACING, FACING * 1.01], truth)
    assert review(everywhere(), cells, at).max() == 1


def test_a_plane_that_cuts_through_several_surfaces_is_split() -> None:
    """Three strips, each of a surface of its own, that one upright plane happens to pass through."""
    labels, truth = np.zeros(SHAPE, np.int32), np.zeros(SHAPE, np.int32)
    planes = []
    for number, (left, degrees) in enumerate([(0, 45), (150, -45), (300, 40)], 1):
        labels[:, left : left + 60] = 1
        truth[:, left : left + 60] = number
        planes.append(leaning(degrees, (left + 30 - SHAPE[1] / 2) / FOCAL))
    found = review(labels, *cells_of(planes, truth))
    for left in (0, 150, 300):
        others = np.delete(found, np.s_[left : left + 60], axis=1)
        assert not set(np.unique(found[:, left : left + 60])) & set(np.unique(others)) - {0}


def test_pieces_of_one_plane_stay_together() -> None:
    labels = np.zeros(SHAPE, np.int32)
    for left in (0, 150, 300):
        labels[:, left : left + 60] = 1
    cells, at = cells_of([leaning(30)], labels)
    assert (review(labels, cells, at) == labels).all()


def test_a_bare_surface_beside_a_matched_one_is_dropped() -> None:
    matched = everywhere()
    matched[:, 180:] = 0
    found = review(everywhere(), *cells_of([FACING], matched))
    assert (found[:, :180] == 1).all()
    assert not found[:, 240:].any()


def test_a_bare_hole_between_matches_is_kept() -> None:
    matched = everywhere()
    matched[100:140, 160:200] = 0
    assert (review(everywhere(), *cells_of([FACING], matched)) == 1).all()


def test_a_region_without_matches_goes_and_the_others_are_numbered_by_size() -> None:
    labels = everywhere(3)
    labels[:, :120], labels[:60, 120:200] = 1, 2
    cells, at = cells_of([FACING, FACING, leaning(30)], np.where(labels == 2, 0, labels))
    found = review(labels, cells, at)
    assert found[200, 300] == 1
    assert found[200, 60] == 2
    assert found[5, 160] == 0


def test_what_is_left_too_small_goes() -> None:
    matched = np.zeros(SHAPE, np.int32)
    matched[:30, :30] = 1
    cells, at = cells_of([FACING], matched)
    assert review(everywhere(), cells, at, least_px=100).any()
    assert not review(everywhere(), cells, at, least_px=10_000).any()


def test_the_same_seed_gives_the_same_labels() -> None:
    truth = everywhere()
    truth[:, 200:] = 2
    cells, at = cells_of([FACING, leaning(40, 0.07)], truth)
    assert (review(everywhere(), cells, at, seed=5) == review(everywhere(), cells, at, seed=5)).all()


def test_two_small_things_far_apart_are_no_plane_together() -> None:
    """A plane passes through both ends of the image; nothing between them lies on it."""
    labels = np.zeros(SHAPE, np.int32)
    labels[60:120, 20:60] = labels[90:150, 300:340] = 1
    cells, at = cells_of([leaning(20)], labels)
    found = review(labels, cells, at)
    assert found.max() == 2
    assert len(np.unique(found[:, :180])) == len(np.unique(found[:, 180:])) == 2


def test_a_facade_seen_between_columns_stays_one_plane() -> None:
    labels = everywhere()
    labels[:, 60::80] = labels[:, 61::80] = 0
    cells, at = cells_of([leaning(20)], labels)
    assert review(labels, cells, at).max() == 1
