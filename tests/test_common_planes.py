"""Planes common to several components whose own matches are too few to tell them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_plane_pieces import FACING, SHAPE, lattice_on, leaning, off_deg

from slopecli.patches.regions import REGION, CellLattice, KnownTilt, Piece, find_common_planes
from slopecli.types import FloatArray

WALL = leaning(50.0)
CORNERS = ((2, 4), (2, 24), (4, 44), (26, 6), (28, 26), (24, 46))  # row and column of the parts, cells
HIGH, WIDE = 8, 11


def parts(planes: list[FloatArray], seed: int, known: float = 0.6) -> tuple[CellLattice, np.ndarray]:
    """Parts of a lattice, each on its plane and with matches in a share of its cells, and their components of px."""
    number = np.zeros(SHAPE, np.int32)
    for k, (row, column) in enumerate(CORNERS[: len(planes)], 1):
        number[row : row + HIGH, column : column + WIDE] = k
    lattice = lattice_on(planes, number, seed)
    matched = lattice.known & (np.random.default_rng(seed).random(SHAPE) < known)
    return replace(lattice, known=matched), number.repeat(REGION.cell_px, 0).repeat(REGION.cell_px, 1)


def found(planes: list[FloatArray], seed: int, pieces: tuple[Piece, ...] = ()) -> list[KnownTilt]:
    lattice, components = parts(planes, seed)
    return find_common_planes(lattice, components, pieces)


def held(plane: KnownTilt) -> list[int]:
    """The parts that a plane holds most of, from 0."""
    return [k for k, (y, x) in enumerate(CORNERS) if plane.piece.cells[y : y + HIGH, x : x + WIDE].mean() > 0.5]


@pytest.mark.parametrize("seed", range(4))
def test_parts_of_one_wall_tell_its_plane_together(seed: int) -> None:
    (wall,) = found([WALL] * 5, seed)
    assert held(wall) == [0, 1, 2, 3, 4]
    assert off_deg(wall.piece, WALL) < 4.0 * np.degrees(wall.sigma_rad)
    assert np.degrees(wall.sigma_rad) < 3.0


@pytest.mark.parametrize("seed", range(4))
def test_a_part_on_another_plane_is_left_out(seed: int) -> None:
    (wall,) = found([WALL, WALL, FACING * 1.3, WALL, WALL], seed)
    assert held(wall) == [0, 1, 3, 4]
    assert off_deg(wall.piece, WALL) < 4.0 * np.degrees(wall.sigma_rad)


def test_parts_of_two_walls_are_two() -> None:
    other = leaning(-40.0) * 0.8
    walls = found([WALL, other, WALL, other, WALL, other], 1)
    assert sorted(held(wall) for wall in walls) == [[0, 2, 4], [1, 3, 5]]


@pytest.mark.parametrize("seed", range(6))
def test_parts_on_planes_of_their_own_have_none_in_common(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    planes = [FACING * rng.uniform(0.5, 1.5) + [*rng.normal(0.0, 0.03, 2), 0.0] for _ in CORNERS]
    assert found(planes, seed) == []


def test_parts_of_a_piece_of_sure_tilt_are_left_to_it() -> None:
    lattice, _ = parts([WALL] * 5, 0)
    assert found([WALL] * 5, 0, (Piece(WALL, 1.0, lattice.known),)) == []


def test_one_part_alone_and_no_matches_at_all_have_none() -> None:
    assert found([WALL], 0) == []
    lattice, components = parts([WALL] * 3, 0, known=0.0)
    assert find_common_planes(lattice, components, ()) == []
