"""What the part of a window that is seen leaves open of the plane nearest to the whole of it."""

from __future__ import annotations

import numpy as np

from slopecli.types import BoolArray, FloatArray

# by how much ground is believed to bend from one place to the next before it is seen, 1-sigma about either axis
BEND_RAD = np.radians(10.0)


def lever(at: FloatArray, seen: BoolArray) -> float:
    """Tilt of the whole over the tilt that sets in where what is seen ends, along the direction it matters most in.

    Parameters
    ----------
    at : (n, 2) places all over the window, px from its middle.  seen : (n,).

    Returns
    -------
    share : 0 where all is seen, 1 where nothing is.
    """
    if seen.all() or not seen.any():
        return 0.0 if seen.all() else 1.0
    gap, known = at[~seen], at[seen]
    nearest = known[((gap[:, None] - known[None]) ** 2).sum(axis=2).argmin(axis=1)]
    gain = np.linalg.lstsq(at.T @ at, gap.T @ (gap - nearest), rcond=None)[0]
    return min(float(np.linalg.norm(gain, 2)), 1.0)
