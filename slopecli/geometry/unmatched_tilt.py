"""Slope uncertainty due to the unmatched part of a window."""

from __future__ import annotations

import numpy as np

from slopecli.types import BoolArray, FloatArray

BEND_RAD = np.radians(10.0)  # 1-sigma by which unmatched ground is assumed to tilt against matched ground, either axis


def lever(at: FloatArray, seen: BoolArray) -> float:
    """Tilt of the plane fitted to the whole window per unit of tilt of its unmatched part, in the worst direction.

    Parameters
    ----------
    at : (n, 2) places all over the window, px from its middle.  seen : (n,) which of them have matches.

    Returns
    -------
    share : 0 where all have matches, 1 where none has.
    """
    if seen.all() or not seen.any():
        return 0.0 if seen.all() else 1.0
    gap, known = at[~seen], at[seen]
    nearest = known[((gap[:, None] - known[None]) ** 2).sum(axis=2).argmin(axis=1)]
    gain = np.linalg.lstsq(at.T @ at, gap.T @ (gap - nearest), rcond=None)[0]
    return min(float(np.linalg.norm(gain, 2)), 1.0)
