"""What of a window image 2 does not show may tilt otherwise: by how much that leaves the slope of the whole open.

`estimate` counts it in its sigma. The sigmas of a plan are those of what is seen; this stands beside them.
"""

from __future__ import annotations

import numpy as np

from slopecli.geometry.unmatched_tilt import BEND_RAD, lever
from slopecli.plan.flight import Flight, in_image2
from slopecli.types import FloatArray


def unseen_tilts(flight: Flight, baseline: float) -> FloatArray:
    """(m,) 1-sigma of the tilt of windows that is owed to what image 2 does not show of them, rad; baseline in heights.

    Only what lies outside image 2 is known beforehand: what is hidden or bare is not.
    """
    inside = in_image2(flight, baseline)
    return BEND_RAD * np.array([lever(flight.places(i), inside[i]) for i in range(len(inside))])
