"""Cells of image 1 explained by few planes: pieces grown, chosen by what they save, merged where they are one."""

from __future__ import annotations

import numpy as np
import pytest

from slopecli.geometry import homogeneous, normal_angle
from slopecli.patches.regions import REGION, CellLattice, Piece, fewest_pieces, grown_pieces, merged

SHAPE, FOCAL = (40, 60), 300.0
SIGMA_PX = 0.08  # of a match
BASELINES_AWAY = 0.1  # inverse depth of the plane x = y = 0
FACING = np.array([0.0, 0.0, BASELINES_AWAY])
NO_COMPONENTS = np.zeros((SHAPE[0] * REGION.cell_px, SHAPE[1] * REGION.cell_px), np.int32)


def leaning(degrees: float, across: float = 0.0) -> np.ndarray:
    """A plane turned about the image's vertical axis, through the point `across` (normalised x) of FACING."""
    slope = BASELINES_AWAY * np.tan(np.radians(degrees))
    return np.array([slope, 0.0, BASELINES_AWAY - slope * across])


def lattice_on(
    planes: list[np.ndarray], number: np.ndarray, seed: int = 0, relief: float = 0.0, sharing: float = 4.0
) -> CellLattice:
    """Noisy cells, each on the plane of its number from 1, none where it is 0; relief: relative RMS off the plane."""
    row, column = np.mgrid[: SHAPE[0], : SHAPE[1]]
    at = np.stack([column - SHAPE[1] / 2, row - SHAPE[0] / 2], -1) * REGION.cell_px / FOCAL
    rays = homogeneous(at.reshape(-1, 2)).reshape(*SHAPE, 3)
    known = number > 0
    w = (rays * np.array(planes)[np.maximum(number, 1) - 1]).sum(-1)
    rng = np.random.default_rng(seed)
    w = w * (1 + relief * rng.normal(size=SHAPE))
    scale = FOCAL / SIGMA_PX
    rows = np.where(known[..., None], rays * scale, 0.0).astype(np.float32)
    target = np.where(known, w * scale + rng.normal(size=SHAPE), 0.0).astype(np.float32)
    return CellLattice(rows, target, known, sharing, 9.0, REGION.cell_px / FOCAL, SIGMA_PX)


def everywhere() -> np.ndarray:
    return np.ones(SHAPE, np.int32)


def two_sides() -> np.ndarray:
    number = everywhere()
    number[:, 33:] = 2
    return number


def explained(lattice: CellLattice, merge_px: float = 1.0) -> list[Piece]:
    return merged(lattice, fewest_pieces(lattice, grown_pieces(lattice, NO_COMPONENTS)), merge_px)


def off_deg(piece: Piece, plane: np.ndarray) -> float:
    return float(np.degrees(normal_angle(piece.plane, plane)))


@pytest.mark.parametrize("seed", range(5))
def test_one_plane_is_one_piece(seed: int) -> None:
    (piece,) = explained(lattice_on([leaning(20)], everywhere(), seed))
    assert off_deg(piece, leaning(20)) < 0.2
    assert piece.cells.mean() > 0.97


@pytest.mark.parametrize("degrees", [25, 60])
def test_two_planes_that_meet_in_an_edge_are_two(degrees: float) -> None:
    hinge = (33 - SHAPE[1] / 2) * REGION.cell_px / FOCAL
    pieces = explained(lattice_on([FACING, leaning(degrees, hinge)], two_sides()))
    assert len(pieces) == 2
    for piece, plane, side in zip(
        pieces, [FACING, leaning(degrees, hinge)], (np.s_[:, :30], np.s_[:, 36:]), strict=True
    ):
        assert off_deg(piece, plane) < 0.5
        assert piece.cells[side].mean() > 0.9


@pytest.mark.parametrize("seed", range(3))
def test_a_fold_that_one_plane_nearly_explains_is_two(seed: int) -> None:
    """Two small sides, eight degrees apart: their common plane is off by less than a coarse tolerance."""
    number = np.zeros(SHAPE, np.int32)
    number[12:26, 18:33], number[12:26, 33:48] = 1, 2
    hinge = (33 - SHAPE[1] / 2) * REGION.cell_px / FOCAL
    pieces = explained(lattice_on([leaning(0, hinge), leaning(8, hinge)], number, seed))
    assert len(pieces) == 2
    assert sorted(off_deg(piece, FACING) for piece in pieces) == pytest.approx([0.0, 8.0], abs=1.5)


def test_a_merged_piece_has_the_tolerance_of_its_cells_not_that_of_a_scrap() -> None:
    number = everywhere()
    number[:4, :4] = 2
    pieces = [Piece(FACING, 1.0, number == 1), Piece(FACING * 1.001, 5.0, number == 2)]
    (piece,) = merged(lattice_on([FACING, FACING * 1.001], number), pieces, 1.0)
    assert piece.tolerance == 1.0


def test_a_surface_with_relief_is_one_piece_with_its_tolerance() -> None:
    (piece,) = explained(lattice_on([leaning(20)], everywhere(), relief=0.003))
    assert piece.tolerance > 1.0
    assert off_deg(piece, leaning(20)) < 1.0


def test_a_plane_that_cuts_through_several_surfaces_explains_none() -> None:
    """Three strips, each of a surface of its own, that one upright plane happens to pass through."""
    number, planes = np.zeros(SHAPE, np.int32), []
    for k, (left, degrees) in enumerate([(0, 45), (25, -45), (50, 40)], 1):
        number[:, left : left + 10] = k
        planes.append(leaning(degrees, (left + 5 - SHAPE[1] / 2) * REGION.cell_px / FOCAL))
    pieces = explained(lattice_on(planes, number))
    for left in (0, 25, 50):
        own = [piece for piece in pieces if piece.cells[:, left : left + 10].any()]
        assert own
        assert not any(np.delete(piece.cells, np.s_[left : left + 10], axis=1).any() for piece in own)


def test_what_lies_on_no_plane_is_in_no_piece() -> None:
    lattice = lattice_on([FACING], everywhere())
    noise = np.random.default_rng(1).uniform(-40, 40, SHAPE).astype(np.float32)
    beside = CellLattice(
        lattice.rows, lattice.target + np.where(two_sides() == 2, noise, 0), lattice.known, 4.0, 9.0, 0.02, SIGMA_PX
    )
    (piece,) = explained(beside)
    assert piece.cells[:, 37:].mean() < 0.02


def pieces_of(number: np.ndarray, planes: list[np.ndarray]) -> list[Piece]:
    return [Piece(plane, 1.0, number == k) for k, plane in enumerate(planes, 1)]


def test_two_pieces_of_one_plane_become_one_unless_told_to_stay_apart() -> None:
    planes = [FACING, FACING * 1.0001]
    lattice, pieces = lattice_on([FACING, FACING], two_sides()), pieces_of(two_sides(), planes)
    (piece,) = merged(lattice, pieces, 1.0)
    assert piece.cells.all()
    assert len(merged(lattice, pieces, 0.0005)) == 2


def test_a_step_that_is_small_beside_the_width_of_the_surface_is_relief() -> None:
    width = np.sqrt(np.count_nonzero(two_sides() == 2)) * REGION.cell_px / FOCAL
    for part, count in ((0.03, 1), (0.2, 2)):
        planes = [FACING, FACING * (1 + part * width)]
        assert len(merged(lattice_on(planes, two_sides()), pieces_of(two_sides(), planes), 1.0)) == count


def test_a_step_counts_perpendicular_to_the_surface_not_along_the_ray() -> None:
    street, number = np.array([0.0, 0.4, 0.06]), two_sides()  # from eye height, seen at 10 to 30 degrees
    number[: SHAPE[0] // 2] = 0
    width = np.sqrt(np.count_nonzero(number == 2)) * REGION.cell_px / FOCAL
    for part, count in ((0.15, 1), (1.2, 2)):
        planes = [street, street * (1 + part * width)]
        assert len(merged(lattice_on(planes, number), pieces_of(number, planes), 50.0)) == count
        across = [FACING, FACING * (1 + part * width)]
        assert len(merged(lattice_on(across, number), pieces_of(number, across), 50.0)) == 2


def test_parallel_planes_stay_apart_however_far_merging_may_reach() -> None:
    planes = [FACING, FACING * 1.1]
    assert len(merged(lattice_on(planes, two_sides()), pieces_of(two_sides(), planes), 50.0)) == 2


def test_two_small_things_far_apart_are_no_plane_together() -> None:
    number = np.zeros(SHAPE, np.int32)
    number[10:16, 2:8], number[10:16, 52:58] = 1, 2
    pieces = pieces_of(number, [leaning(20), leaning(20)])
    assert len(merged(lattice_on([leaning(20), leaning(20)], number), pieces, 1.0)) == 2


def test_without_cells_there_is_no_piece() -> None:
    assert explained(lattice_on([FACING], np.zeros(SHAPE, np.int32))) == []
