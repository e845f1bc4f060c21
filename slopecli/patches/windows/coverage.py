"""The cells of a window with and without matches, and how the unmatched ones tilt its least-squares plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.patches.windows.tunables import TUNE
from slopecli.types import BoolArray, FloatArray, IntArray
from slopecli.windows import Window


@dataclass(frozen=True, eq=False)
class Gaps:
    """A window divided into cells, and which of them hold a match.

    at, uv1 (k, 2): centres of the cells, px from the window's middle, and px of image 1; seen (k,): holds a match;
    shape: rows and columns of cells; cell_px: side of one; matched (n, 2): px of the matches; per_px: how many of them
    there are to a square px where there are no gaps.
    """

    window: Window
    at: FloatArray
    uv1: FloatArray
    seen: BoolArray
    shape: tuple[int, int]
    cell_px: float
    matched: FloatArray
    per_px: float

    @property
    def unseen(self) -> FloatArray:
        """(g, 2) px of image 1: centres of the cells without a match."""
        return self.uv1[~self.seen]

    def tilt_rad(self, height_px: FloatArray | float, which: BoolArray | None = None) -> float:
        """Tilt of the least-squares plane of the whole window if its unmatched cells stand off the plane, rad.

        Parameters
        ----------
        height_px : (g,) of the cells without a match, or one for all, px of image 1 at their distance.
        which : (g,) mask of the cells that stand off; None: all of them, which is the worst case.
        """
        at = self.at[~self.seen]
        height = np.broadcast_to(height_px, len(at)) * (True if which is None else which)
        return float(np.arctan(np.linalg.norm(np.linalg.lstsq(self.at.T @ self.at, at.T @ height, rcond=None)[0])))

    def holds(self, uv1: FloatArray) -> BoolArray:
        """(k,) whether points (k, 2) px of image 1 lie in a cell with a match."""
        column, row, inside = _cell(self.window, self.shape, uv1)
        return np.asarray(inside & self.seen[row * self.shape[1] + column])

    def filled(self, uv1: FloatArray) -> FloatArray:
        """(k,) density of matches around points (k, 2) px of image 1, relative to that of the matched part.

        Outside the window the density counts as zero.
        """
        reach = 1.5 * self.cell_px
        u, v = (uv1[:, k, None] - self.matched[None, :, k] for k in (0, 1))
        around = (u * u + v * v < reach**2).sum(axis=1)
        return np.asarray(around / (self.per_px * np.pi * reach**2))


def gaps_of(window: Window, uv1: FloatArray, share: float) -> Gaps:
    """The gaps between matches (n, 2) px of image 1 that cover this share of a window."""
    x, y, w, h = window
    # cells so large that none is empty where the window is matched
    side = max(max(w, h) / TUNE.cells_across, 3.0, 1.5 * float(np.sqrt(w * h / max(len(uv1), 1))))
    columns, rows = max(round(w / side), 1), max(round(h / side), 1)
    column, row, _ = _cell(window, (rows, columns), uv1)
    seen = np.zeros((rows, columns), bool)
    seen[row, column] = True
    v, u = np.mgrid[:rows, :columns]
    at = np.stack([(u + 0.5) / columns * w - 0.5 * w, (v + 0.5) / rows * h - 0.5 * h], axis=-1).reshape(-1, 2)
    middle = np.array([x + 0.5 * w - 0.5, y + 0.5 * h - 0.5])
    per_px = len(uv1) / max(share, 0.01) / (w * h)
    return Gaps(window, at, at + middle, seen.ravel(), (rows, columns), side, uv1, per_px)


def _cell(window: Window, shape: tuple[int, int], uv1: FloatArray) -> tuple[IntArray, IntArray, BoolArray]:
    """Column and row (k,) of the cell of points (k, 2), the nearest for those outside, and which are inside."""
    x, y, w, h = window
    rows, columns = shape
    column = np.floor((uv1[:, 0] + 0.5 - x) * columns / w).astype(int)
    row = np.floor((uv1[:, 1] + 0.5 - y) * rows / h).astype(int)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    return np.clip(column, 0, columns - 1), np.clip(row, 0, rows - 1), inside
