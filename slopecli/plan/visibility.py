"""Slope uncertainty of windows due to their part outside image 2.

`estimate` adds it to its sigma. The sigmas of a plan are those of the part that is seen; this is given beside them.
"""

from __future__ import annotations

import numpy as np

from slopecli.geometry.plane_fit import BEND_RAD, lever
from slopecli.plan.flight import Flight, in_image2
from slopecli.types import FloatArray


def unseen_tilts(flight: Flight, baseline: float) -> FloatArray:
    """(m,) 1-sigma of the tilt of windows due to their part outside image 2, rad; baseline in heights.

    Parts that will be hidden or without texture are not known beforehand.
    """
    inside = in_image2(flight, baseline)
    return BEND_RAD * np.array([lever(flight.places(i), inside[i]) for i in range(len(inside))])
