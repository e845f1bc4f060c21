"""Where a window has matches and where it has none, and what the least squares over all of it make of the rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.planes.windows import Window
from slopecli.types import BoolArray, FloatArray

ACROSS = 16  # cells a window is divided into along its longer side, to count what is seen
LEAST_CELL_PX = 3.0  # and not smaller than this


@dataclass(frozen=True, eq=False)
class Gaps:
    """A window in cells: `at` (k, 2) centres, px from the window's middle; `uv1` (k, 2) px of image 1; seen (k,): holds
    a match. `cell_px`: side of a cell; `matched` (n, 2) px of the matches; `per_px`: matches where there are no gaps.
    """

    window: Window
    at: FloatArray
    uv1: FloatArray
    seen: BoolArray
    cell_px: float
    matched: FloatArray
    per_px: float

    @property
    def unseen(self) -> FloatArray:
        """(g, 2) px of image 1: centres of the cells without a match."""
        return self.uv1[~self.seen]

    def tilt_rad(self, height_px: FloatArray | float, which: BoolArray | None = None) -> float:
        """How much the plane of the whole window tilts where cells without a match stand off it.

        Parameters
        ----------
        height_px : (g,) of the cells without a match, or one for all, px of image 1 at their distance.
        which : (g,) those that stand there; None: all of them. Neighbours are equally high; the worst is that all are.
        """
        at = self.at[~self.seen]
        height = np.broadcast_to(height_px, len(at)) * (True if which is None else which)
        return float(np.arctan(np.linalg.norm(np.linalg.lstsq(self.at.T @ self.at, at.T @ height, rcond=None)[0])))

    def filled(self, uv1: FloatArray) -> FloatArray:
        """(k,) matches around points (k, 2) px of image 1 over what there are where the window has no gaps."""
        reach = 1.5 * self.cell_px
        around = (((uv1[:, None] - self.matched[None]) ** 2).sum(axis=2) < reach**2).sum(axis=1)
        return np.asarray(around / (self.per_px * np.pi * reach**2))


def gaps_of(window: Window, uv1: FloatArray, share: float) -> Gaps:
    """The gaps between matches (n, 2) px of image 1 that cover this share of a window."""
    x, y, w, h = window
    # where a window is matched, no cell is empty
    side = max(max(w, h) / ACROSS, LEAST_CELL_PX, 1.5 * float(np.sqrt(w * h / max(len(uv1), 1))))
    columns, rows = max(round(w / side), 1), max(round(h / side), 1)
    column = np.clip(((uv1[:, 0] + 0.5 - x) * columns / w).astype(int), 0, columns - 1)
    row = np.clip(((uv1[:, 1] + 0.5 - y) * rows / h).astype(int), 0, rows - 1)
    seen = np.zeros((rows, columns), bool)
    seen[row, column] = True
    v, u = np.mgrid[:rows, :columns]
    at = np.stack([(u + 0.5) / columns * w - 0.5 * w, (v + 0.5) / rows * h - 0.5 * h], axis=-1).reshape(-1, 2)
    middle = np.array([x + 0.5 * w - 0.5, y + 0.5 * h - 0.5])
    return Gaps(window, at, at + middle, seen.ravel(), side, uv1, len(uv1) / max(share, 0.01) / (w * h))
