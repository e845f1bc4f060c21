"""Planes common to several components of low gradient, such as the parts of a wall between shelves.

The few matches of a bare part leave its tilt open, so that a plane of its own would be a poor one; the parts together
tell their plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import cv2
import numpy as np

from slopecli.geometry.epipolar import normal_angle
from slopecli.geometry.statistics import GATE_SIGMAS, geman_mcclure
from slopecli.look.gradient_components import Labels
from slopecli.patches.labelling.depth_planes import solve_regular
from slopecli.patches.regions.cell_lattice import CellLattice, component_of_cells
from slopecli.patches.regions.plane_pieces import KnownTilt, Piece, tilt_sigma_rad
from slopecli.patches.regions.region_tunables import REGION
from slopecli.patches.windows.raw_grey import KNOWN
from slopecli.types import BoolArray, FloatArray, IntArray


def find_common_planes(lattice: CellLattice, components: Labels, pieces: Sequence[Piece]) -> list[KnownTilt]:
    """Return planes that several components (h, w) working px, 1..k, lie on, each with these parts of them.

    A component counts if most of its matched cells lie on the plane that fits the others, and save what a plane costs.
    The cells are those between its matched ones. Components that a piece of sure tilt explains are left to it.
    """
    parts = _Parts.of(lattice, components, pieces)
    found = list[KnownTilt]()
    while len(parts.numbers) > 1:
        proposed = parts.proposed()
        held = parts.held(proposed)
        first = np.unique(held[held.sum(1) > 1], axis=0, return_index=True)[1]  # one of those that hold the same parts
        settled = [one for plane in proposed[held.sum(1) > 1][first] if (one := _settled(parts, plane)) is not None]
        if not settled:
            break
        _, plane, held = max(settled, key=lambda one: one[0])
        piece = Piece(plane, 1.0, _between(lattice.on_plane(plane, 1.0), parts.inside, parts.numbers[held]))
        found.append(
            KnownTilt(piece, float(np.hypot(parts.jackknife_rad(plane, held), tilt_sigma_rad(lattice, piece))))
        )
        parts = parts.without(held)
    return found


@dataclass(frozen=True, eq=False)
class _Parts:
    """The matched cells (n,) of k components as equations of planes.

    inside (h, w) : the component of every cell.  numbers (k,) : of the components in it.  part (n,) : 0..k-1, rising.
    rows (n, 3), target (n,) : as in the lattice.
    """

    lattice: CellLattice
    inside: Labels
    numbers: IntArray
    part: IntArray
    rows: FloatArray
    target: FloatArray

    @classmethod
    def of(cls, lattice: CellLattice, components: Labels, pieces: Sequence[Piece]) -> _Parts:
        """Return the components that may save the price of a plane, without those held by a piece of sure tilt."""
        inside = component_of_cells(components, lattice.shape)
        count = np.bincount(inside[lattice.known], minlength=components.max() + 1)
        wanted = lattice.unexplained * count > lattice.price
        wanted[0] = False
        for piece in pieces:
            if tilt_sigma_rad(lattice, piece) < KNOWN.sure_rad:
                held = np.bincount(inside[piece.cells & lattice.known], minlength=len(count))
                wanted &= held < REGION.compact * count
        return cls._of_numbers(lattice, inside, np.flatnonzero(wanted))

    @classmethod
    def _of_numbers(cls, lattice: CellLattice, inside: Labels, numbers: IntArray) -> _Parts:
        """Return the components of these numbers."""
        own = lattice.known & np.isin(inside, numbers)
        part = np.searchsorted(numbers, inside[own])
        order = np.argsort(part, kind="stable")
        rows, target = lattice.rows[own][order].astype(float), lattice.target[own][order].astype(float)
        return cls(lattice, inside, numbers, part[order], rows, target)

    def without(self, held: BoolArray) -> _Parts:
        """Return the parts but those (k,) held."""
        return self._of_numbers(self.lattice, self.inside, self.numbers[~held])

    def proposed(self) -> FloatArray:
        """Return the planes (p, 3) of any two parts."""
        system, right = self.systems(np.ones(len(self.rows)))
        pairs = np.array(list(combinations(range(len(self.numbers)), 2)))
        return solve_regular(system[pairs].sum(1), right[pairs].sum(1))

    def systems(self, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the normal equations (k, 3, 3), (k, 3) of each part; weight (n,)."""
        number = len(self.numbers)
        products = [self.rows[:, i] * by * weight for i in range(3) for by in (*self.rows.T, self.target)]
        columns = [np.bincount(self.part, one, number) for one in products]
        sums = np.asarray(np.stack(columns, -1), float).reshape(number, 3, 4)
        return sums[..., :3], sums[..., 3]

    def jackknife_rad(self, plane: FloatArray, held: BoolArray) -> float:
        """Return the 1-sigma of the tilt of the plane (3,) that fits the parts (k,) held, as they differ."""
        _, others = self.fitted(plane, held)
        apart = normal_angle(plane, others[held])
        return float(np.sqrt((1.0 - 1.0 / len(apart)) * np.sum(apart**2)))

    def fitted(self, plane: FloatArray, held: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Return the plane (3,) that fits the parts (k,) held, and those (k, 3) that fit all but one of them.

        Cells far off the present plane (3,) are weighted down.
        """
        system, right = self.systems(geman_mcclure(self.rows @ plane - self.target, GATE_SIGMAS))
        total, both = system[held].sum(0), right[held].sum(0)
        others = solve_regular(total - held[:, None, None] * system, both - held[:, None] * right)
        return solve_regular(total, both), others

    def held(self, planes: FloatArray) -> BoolArray:
        """Return (p, k) whether most cells of each part lie on each plane (p, 3), and save what a plane costs."""
        at_once = 1 + 2**22 // len(self.rows)  # 32 MB of distances
        blocks = [planes[k : k + at_once] for k in range(0, len(planes), at_once)]
        return np.concatenate([self._lie_on(np.abs(some @ self.rows.T - self.target)) for some in blocks])

    def held_each(self, planes: FloatArray) -> BoolArray:
        """Return (k,) the same of each part and its own plane (k, 3)."""
        return self._lie_on(np.abs((self.rows * planes[self.part]).sum(1) - self.target))

    def _lie_on(self, off: FloatArray) -> BoolArray:
        """Return (..., k) the same by the distances (..., n) of cells from planes, sigmas."""
        first = np.searchsorted(self.part, np.arange(len(self.numbers)))
        saved = np.asarray(self.lattice.unexplained - self.lattice.cost(off.astype(np.float32), 1.0), float)
        near = np.add.reduceat((off < GATE_SIGMAS).astype(float), first, axis=-1)
        most = near >= REGION.compact * np.bincount(self.part)
        return np.asarray(most & (np.add.reduceat(saved, first, axis=-1) > self.lattice.price))


def _settled(parts: _Parts, plane: FloatArray) -> tuple[int, FloatArray, BoolArray] | None:
    """Return the number of cells on a plane fitted to the parts on it, the plane (3,), and these parts (k,).

    Each is held by the plane that fits the others as well. None if that leaves fewer than two.
    """
    held = parts.held(plane[None])[0]
    for _ in range(10):  # settles in three or four
        if np.count_nonzero(held) < 2:
            return None
        plane, others = parts.fitted(plane, held)
        now = parts.held(plane[None])[0] & parts.held_each(others)
        if np.array_equal(now, held):
            return int((np.abs(parts.rows @ plane - parts.target) < GATE_SIGMAS)[held[parts.part]].sum()), plane, held
        held = now
    return None


def _between(on_plane: BoolArray, inside: Labels, numbers: IntArray) -> BoolArray:
    """Return the cells (h, w) of the components of these numbers that lie between their cells on the plane."""
    cells = np.zeros(inside.shape, bool)
    for number in numbers:
        hull = np.zeros(inside.shape, np.uint8)
        corners = cv2.convexHull(np.argwhere(on_plane & (inside == number))[:, ::-1].astype(np.int32))
        cv2.fillConvexPoly(hull, corners, 1)
        cells |= (hull > 0) & (inside == number)
    return cells
