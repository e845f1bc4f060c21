"""Pieces merged where they are one plane, or one surface with relief.

Source: Cheng, experiment 3, step 6: neighbours are one region if one plane transfers both.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from slopecli.geometry.epipolar import normal_angle
from slopecli.geometry.statistics import CHI2, median
from slopecli.patches.labelling.depth_planes import solve_regular
from slopecli.patches.regions.cell_lattice import CellLattice
from slopecli.patches.regions.plane_pieces import Piece, weighted_system
from slopecli.patches.regions.region_tunables import REGION
from slopecli.types import BoolArray, FloatArray


def merged(lattice: CellLattice, pieces: list[Piece], merge_px: float) -> list[Piece]:
    """Return the pieces after merging, most alike first, those that are one, largest first.

    Two neighbours are one plane if they send the cells of the smaller within `merge_px` of each other and one plane
    serves both. Side by side and parallel, they are one surface with relief if the step is a small part of the width
    of the smaller, and is within the largest of the tolerances of `merge_px`.
    """
    state = {k: _Member.of(lattice, piece) for k, piece in enumerate(pieces)}
    limit = merge_px / lattice.sigma_px
    pairs = {(i, j): one for j in state for i in range(j) if (one := _joined(lattice, state[i], state[j], limit))}
    while pairs:
        (i, j), (_, piece) = min(pairs.items(), key=lambda pair: (pair[1][0], pair[0]))
        del state[j]
        state[i] = _Member.of(lattice, piece)
        pairs = {both: one for both, one in pairs.items() if i not in both and j not in both}
        for k in state:
            if k != i and (one := _joined(lattice, state[min(i, k)], state[max(i, k)], limit)):
                pairs[min(i, k), max(i, k)] = one
    return [one.piece for one in sorted(state.values(), key=lambda one: -one.count)]


@dataclass(frozen=True, eq=False)
class _Member:
    """A piece with the normal equations of its plane, the number of its known cells and the distance (h, w) to it."""

    piece: Piece
    system: FloatArray
    right: FloatArray
    count: int
    distance: FloatArray

    @classmethod
    def of(cls, lattice: CellLattice, piece: Piece) -> _Member:
        system, right = weighted_system(lattice, piece.plane, piece.tolerance, piece.cells)
        distance = cv2.distanceTransform((~piece.cells).astype(np.uint8), cv2.DIST_L2, 3)
        return cls(piece, system, right, int(np.count_nonzero(piece.cells & lattice.known)), np.asarray(distance))


def _joined(lattice: CellLattice, one: _Member, other: _Member, limit: float) -> tuple[float, Piece] | None:
    """Return how unlike two pieces are, and the piece of both; None if they stay apart.

    limit : median distance between the planes over the smaller, in sigmas, up to which they may be one.
    """
    large, small = (one, other) if one.count >= other.count else (other, one)
    apart = float(large.distance[small.piece.cells].min())
    if apart > max(np.sqrt(small.count), 2.0):
        return None
    own = small.piece.cells & lattice.known
    between = lattice.rows[own] @ (large.piece.plane - small.piece.plane)
    step = median(np.abs(between))
    if step > max(REGION.tolerances) * limit:
        return None
    cells = one.piece.cells | other.piece.cells
    plane = solve_regular(one.system + other.system, one.right + other.right)
    lost = sum(_quadratic(member.system, member.piece.plane - plane) for member in (one, other))
    same = lost / (CHI2[3, 0.999] * lattice.sharing + REGION.alike * small.count)
    if same < 1.0 and step <= limit:
        return same, Piece(plane, _tolerance(lattice, plane, cells), cells)
    if apart > 2.0:
        return None
    if np.degrees(normal_angle(large.piece.plane, small.piece.plane)) > REGION.parallel_deg:
        return None
    unlike = float(_step_in_widths(lattice, small, between) / REGION.relief)
    if unlike > 1.0:
        return None
    return 1.0 + unlike, Piece(plane, _tolerance(lattice, plane, cells), cells)


def _step_in_widths(lattice: CellLattice, small: _Member, between: FloatArray) -> float:
    """Return the offset of another plane from that of a piece, perpendicular to it, in widths of its surface.

    between (n,) : of the other plane from this one at the known cells of the piece, sigmas.
    """
    own = small.piece.cells & lattice.known
    rows = lattice.rows[own].astype(float)
    facing = np.abs(rows @ small.piece.plane) / (np.linalg.norm(rows, axis=1) * np.linalg.norm(small.piece.plane))
    offset = np.sqrt(np.mean((between / lattice.target[own] * facing) ** 2))  # in distances
    return float(offset / (np.sqrt(small.count / facing.mean()) * lattice.width))


def _tolerance(lattice: CellLattice, plane: FloatArray, cells: BoolArray) -> float:
    """Return the likeliest tolerance of a surface, sigmas, by the distance of its cells (h, w) from its plane."""
    off = lattice.off(plane)[cells & lattice.known]
    tried = [*REGION.tolerances, max(1.0, float(np.sqrt(np.mean(off**2))))]
    return min(tried, key=lambda tolerance: float(lattice.cost(off, tolerance).sum()))


def _quadratic(system: FloatArray, step: FloatArray) -> float:
    return float(step @ system @ step)
