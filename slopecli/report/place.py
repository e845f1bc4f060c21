"""Where camera 1 was and where north is from it, as far as the options tell."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.slope import aspects, north_direction
from slopecli.options import Options, Place
from slopecli.types import Up


def place_of(options: Options, up: Up) -> Place | None:
    """The place of camera 1; None where neither its position nor north is given.

    Raises
    ------
    InputError : north is vertical.
    """
    if options.north is None:
        return None if options.position is None else Place(options.position)
    vertical = np.array(up.vector_cam1)
    north, ahead = (north_direction(vertical, given) for given in (np.array(options.north, float), None))
    x, y, z = (float(part) for part in north)
    heading = float(np.degrees(aspects(ahead[None], vertical, north)[0]))
    return Place(options.position, (x, y, z), heading, options.north_sigma_deg)
