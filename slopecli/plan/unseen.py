"""What of a window image 2 does not show may tilt otherwise: by how much that leaves the slope of the whole open.

`estimate` counts it in its sigma. The sigmas of a plan are those of what is seen; this stands beside them.
"""

from __future__ import annotations

import numpy as np

from slopecli.plan.flight import Flight, in_image2
from slopecli.types import BoolArray, FloatArray

# what `slopecli.planes.unseen` believes of ground before it is seen; a test holds both to be the same
BEND_RAD = np.radians(10.0)


def unseen_tilts(flight: Flight, baseline: float) -> FloatArray:
    """(m,) 1-sigma of the tilt of windows that is owed to what image 2 does not show of them, rad; baseline in heights.

    Only what lies outside image 2 is known beforehand: what is hidden or bare is not.
    """
    inside = in_image2(flight, baseline)
    return BEND_RAD * np.array([_lever(flight.places(i), inside[i]) for i in range(len(inside))])


def _lever(at: FloatArray, seen: BoolArray) -> float:
    """Tilt of the whole over the tilt that sets in where what is seen ends, as in `slopecli.planes.unseen`.

    at : (n, 2) px from the window's middle.  seen : (n,).
    """
    if seen.all() or not seen.any():
        return 0.0 if seen.all() else 1.0
    gap, known = at[~seen], at[seen]
    nearest = known[((gap[:, None] - known[None]) ** 2).sum(axis=2).argmin(axis=1)]
    gain = np.linalg.lstsq(at.T @ at, gap.T @ (gap - nearest), rcond=None)[0]
    return min(float(np.linalg.norm(gain, 2)), 1.0)
