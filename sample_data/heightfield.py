"""First intersections of rays with a heightfield."""

from __future__ import annotations

import numpy as np
from rendering import FloatArray, bilinear


class RayCaster:
    """First intersections of rays with a heightfield (n, n), interpolated bilinearly between its points.

    Rays first descend to coarse upper envelopes of the surface, which can be done in long safe steps (the envelope of
    radius r holds for a lateral step of r), then march in half cells until they are below, then close in by secants.

    Parameters
    ----------
    height : (n, n) heights in metres; point (i, j) stands at x = (j - n/2) cell, y = (i - n/2) cell.
    cell : spacing of the points in metres.
    """

    def __init__(self, height: FloatArray, cell: float) -> None:
        from scipy.ndimage import maximum_filter

        self.height, self.cell = height, cell
        self.floor, self.ceiling = float(height.min()), float(height.max())
        self.envelopes = [(r * cell, maximum_filter(height, 2 * r + 3)) for r in (64, 16, 4)]

    def depth(self, origin: FloatArray, directions: FloatArray) -> FloatArray:
        """Ray parameter (n,) of the first hit of each ray (n, 3), which must point down."""
        speed = np.hypot(directions[:, 0], directions[:, 1])
        t = (self.ceiling + self.cell - origin[2]) / directions[:, 2]
        for reach, envelope in self.envelopes:
            self.descend(origin, directions, t, reach / speed, envelope)
        before, after = self.march(origin, directions, t, 0.5 * self.cell / speed)
        return self.close_in(origin, directions, before, after)

    def sample(self, grid: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
        """Values (n,) of a grid of the heightfield's shape at world coordinates (n,)."""
        middle = len(self.height) / 2
        return bilinear(grid, x / self.cell + middle, y / self.cell + middle)

    def above(self, grid: FloatArray, origin: FloatArray, directions: FloatArray, t: FloatArray) -> FloatArray:
        """Height (n,) of the rays' points over a grid."""
        x, y, z = (origin[k] + t * directions[:, k] for k in range(3))
        return z - self.sample(grid, x, y)

    def descend(
        self, origin: FloatArray, directions: FloatArray, t: FloatArray, longest: FloatArray, envelope: FloatArray
    ) -> None:
        """Move the ray parameters t (n,) towards an envelope, by at most `longest` (n,) a step."""
        active = np.arange(len(t))
        for _ in range(12):
            drop = self.above(envelope, origin, directions[active], t[active]) / -directions[active, 2]
            t[active] += np.minimum(np.maximum(drop, 0), longest[active])
            active = active[drop > 0.1 * longest[active]]

    def march(
        self, origin: FloatArray, directions: FloatArray, t: FloatArray, step: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Ray parameters (n,) just above and just below the first crossing, at most one step (n,) apart."""
        before, after = t.copy(), t.copy()
        active = np.arange(len(t))
        while len(active):
            start = after[active]
            to_floor = (self.floor - self.cell - origin[2]) / directions[active, 2] - start
            stop = start + np.minimum(step[active], to_floor)
            before[active], after[active] = start, stop
            active = active[self.above(self.height, origin, directions[active], stop) > 0]
        return before, after

    def close_in(self, origin: FloatArray, directions: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Ray parameter (n,) of the crossing between a point above and one below, by bracketed secants."""
        f_low, f_high = (self.above(self.height, origin, directions, t) for t in (low, high))
        for _ in range(6):
            middle = low + (high - low) * f_low / (f_low - f_high)
            f_middle = self.above(self.height, origin, directions, middle)
            over = f_middle > 0
            low, f_low = np.where(over, middle, low), np.where(over, f_middle, f_low)
            high, f_high = np.where(over, high, middle), np.where(over, f_high, f_middle)
        return middle
