"""Compact pieces of planes, grown from the planes proposed, and the fewest of them that explain the cells."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.geometry.epipolar import tangent_basis
from slopecli.geometry.statistics import GATE_SIGMAS, geman_mcclure
from slopecli.look.gradient_components import Labels
from slopecli.look.matches import MIN_ON_PLANE
from slopecli.patches.labelling.depth_planes import solve_regular
from slopecli.patches.labelling.energy import cover
from slopecli.patches.regions.cell_lattice import CellLattice
from slopecli.patches.regions.plane_seeds import plane_seeds
from slopecli.patches.regions.region_tunables import REGION
from slopecli.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Piece:
    """A plane (3,), scaled normal; the tolerance of its surface, sigmas; its cells (h, w)."""

    plane: FloatArray
    tolerance: float
    cells: BoolArray


@dataclass(frozen=True, eq=False)
class KnownTilt:
    """A piece whose own matches leave its tilt open, with the 1-sigma of the tilt as known from elsewhere, rad."""

    piece: Piece
    sigma_rad: float


def grown_pieces(lattice: CellLattice, components: Labels) -> list[Piece]:
    """Return compact pieces, each grown from a proposed plane; they overlap.

    The proposals that may save most, beside the pieces grown so far, come first. Each grows at several tolerances.
    Of the pieces that would be chosen, those that two planes explain better propose these, too.
    components : (h, w) working px.
    """
    seeds, density = plane_seeds(lattice, components), around(lattice.known)
    none = np.where(lattice.known, lattice.unexplained, 0.0)
    current, waiting = none, np.ones(len(seeds), bool)
    pieces: list[Piece] = []
    while waiting.any() and len(pieces) < REGION.most_pieces:
        saving = np.where(waiting, seeds.saving(current), -np.inf)
        k = int(saving.argmax())
        if saving[k] < lattice.price:
            break
        waiting[k] = False
        grown = _at_tolerances(lattice, seeds.planes[k], seeds.part(k), density)
        pieces += grown
        if grown:
            current = min((np.minimum(current, _cost_with(lattice, piece, none)) for piece in grown), key=np.sum)
    halves = [half for piece in fewest_pieces(lattice, pieces) for half in _split_at_fold(lattice, piece)]
    return [*pieces, *(piece for plane, part in halves for piece in _at_tolerances(lattice, plane, part, density))]


def _at_tolerances(lattice: CellLattice, plane: FloatArray, part: BoolArray, density: FloatArray) -> list[Piece]:
    """Return the pieces on a plane (3,) that grow from a part (h, w) at each tolerance and save their price.

    Each also grows from the plane of the piece of the next larger tolerance; the one that saves more is returned.
    """
    pieces, starts = list[Piece](), [plane]
    for tolerance in sorted(REGION.tolerances, reverse=True):
        grown = (_grown(lattice, start, tolerance, part, density) for start in starts)
        best = max(
            (piece for piece in grown if piece is not None), key=lambda piece: _saved(lattice, piece), default=None
        )
        if best is not None:
            starts = [plane, best.plane]
            if _saved(lattice, best) >= lattice.price:
                pieces.append(best)
    return pieces


def _saved(lattice: CellLattice, piece: Piece) -> float:
    """Return the cost that a piece saves of its cells on no plane."""
    own = piece.cells & lattice.known
    return float((lattice.unexplained - lattice.cost(lattice.off(piece.plane)[own], piece.tolerance)).sum())


def _split_at_fold(lattice: CellLattice, piece: Piece) -> list[tuple[FloatArray, BoolArray]]:
    """Return two planes (3,), each with its part (h, w) of a piece, that save more than a plane costs; else none."""
    own = piece.cells & lattice.known
    rows, target = lattice.rows[own].astype(float), lattice.target[own].astype(float)
    best, found = float(lattice.cost(lattice.off(piece.plane)[own], piece.tolerance).sum()) - lattice.price, None
    at = np.argwhere(own)
    for direction in ((0, 1), (1, 0), (1, 1), (1, -1)):
        first = (at - at.mean(0)) @ direction > 0
        planes = np.empty((0, 3))
        for _ in range(5):  # settles in three or four
            if min(np.count_nonzero(first), np.count_nonzero(~first)) < MIN_ON_PLANE:
                planes = np.empty((0, 3))
                break
            sides = np.stack([first, ~first]).astype(float)
            planes = solve_regular((rows.T * sides[:, None]) @ rows, (sides * target) @ rows)
            off = np.abs(planes @ rows.T - target)
            nearer = np.zeros(lattice.shape, np.float32)
            nearer[own] = np.clip(off[0] - off[1], -GATE_SIGMAS, GATE_SIGMAS)
            last, first = first, cv2.blur(nearer, (3, 3))[own] < 0  # neighbours are on one side
            if np.array_equal(first, last):
                break
        if len(planes):
            cost = float(lattice.cost(np.where(first, *off), 1.0).sum())  # each half flat: no tolerance beyond noise
            if cost < best:
                best, found = cost, (planes, first)
    if found is None:
        return []
    parts = np.zeros((2, *lattice.shape), bool)
    parts[:, own] = found[1], ~found[1]
    return list(zip(found[0], parts, strict=True))


def fewest_pieces(lattice: CellLattice, pieces: list[Piece]) -> list[Piece]:
    """Return the pieces that together explain the cells, each with the cells that it explains best.

    Each saves more than the price of a plane beside the others.
    """
    if not pieces:
        return []
    none = np.where(lattice.known, lattice.unexplained, 0.0)
    cost = np.stack([_cost_with(lattice, piece, none)[lattice.known] for piece in pieces], -1)
    chosen = _worth_their_price(cost, cover(cost, none[lattice.known], lattice.price), lattice)
    if not len(chosen):
        return []
    own = np.full(lattice.shape, -1)
    own[lattice.known] = np.where(cost[:, chosen].min(1) < lattice.unexplained, cost[:, chosen].argmin(1), -1)
    found = [Piece(pieces[k].plane, pieces[k].tolerance, own == at) for at, k in enumerate(chosen)]
    return [piece for piece in found if np.count_nonzero(piece.cells) >= MIN_ON_PLANE]


def _worth_their_price(cost: FloatArray, chosen: IntArray, lattice: CellLattice) -> IntArray:
    """Return the chosen columns of the costs (n, c) without those that the others came to replace."""
    while len(chosen) > 1:
        with_none = np.column_stack([cost[:, chosen], np.full(len(cost), lattice.unexplained)])
        first, second = np.partition(with_none, 1, axis=1)[:, :2].T
        loss = np.bincount(with_none.argmin(1), second - first, len(chosen) + 1)[:-1]
        if loss.min() >= lattice.price:
            break
        chosen = np.delete(chosen, loss.argmin())
    return chosen


def weighted_system(
    lattice: CellLattice, plane: FloatArray, tolerance: float, cells: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations (3, 3), (3,) of a plane through cells (h, w), those far off it weighted down."""
    own = cells & lattice.known
    rows, target = lattice.rows[own].astype(float), lattice.target[own].astype(float)
    weighted = rows.T * (geman_mcclure(rows @ plane - target, GATE_SIGMAS * tolerance) / tolerance**2)
    return weighted @ rows, weighted @ target


def tilt_sigma_rad(lattice: CellLattice, piece: Piece) -> float:
    """Return the 1-sigma of the direction of the normal of a piece, by its cells."""
    system, _ = weighted_system(lattice, piece.plane, piece.tolerance, piece.cells)
    length = float(np.linalg.norm(piece.plane))
    basis = tangent_basis(piece.plane / length)
    covariance = basis.T @ np.linalg.pinv(system / lattice.sharing) @ basis / length**2
    return float(np.sqrt(0.5 * np.trace(covariance)))


def _grown(
    lattice: CellLattice, plane: FloatArray, tolerance: float, part: BoolArray, density: FloatArray
) -> Piece | None:
    """Return the compact piece on a plane that shares most with a part (h, w), fitted twice; None if there is none.

    density : (h, w) number of known cells around each.
    """
    fitted, cells = plane, part
    for _ in range(3):
        grown = _compact(lattice.on_plane(plane, tolerance), part, density)
        if grown is None or np.count_nonzero(grown & lattice.known) < MIN_ON_PLANE:
            return None
        fitted, cells, plane = plane, grown, solve_regular(*weighted_system(lattice, plane, tolerance, grown))
    return Piece(fitted, tolerance, cells)


def _compact(on_plane: BoolArray, part: BoolArray, density: FloatArray) -> BoolArray | None:
    """Return the connected cells (h, w) amid cells on the plane that share most with a part; None if none do."""
    amid = (around(on_plane) >= REGION.compact * density) & (density >= MIN_ON_PLANE)
    count, pieces = cv2.connectedComponents(amid.astype(np.uint8), connectivity=4)
    shared = np.bincount(pieces[part], minlength=count)
    shared[0] = 0
    return np.asarray(pieces == shared.argmax()) if shared.any() else None


def around(mask: BoolArray) -> FloatArray:
    """Return the number (h, w) of cells of a mask in the square around each."""
    side = REGION.near_cells
    return np.asarray(
        cv2.boxFilter(mask.astype(np.float32), -1, (side, side), normalize=False, borderType=cv2.BORDER_CONSTANT)
    )


def _cost_with(lattice: CellLattice, piece: Piece, none: FloatArray) -> FloatArray:
    """Return the costs (h, w) of cells with a piece alone; `none` are those without any."""
    cost = lattice.cost(lattice.off(piece.plane), piece.tolerance)
    return np.where(piece.cells & lattice.known, cost, none)
