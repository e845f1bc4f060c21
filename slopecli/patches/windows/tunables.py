"""All tunables of the windows finder, each with its unit and the reason for its value."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class WindowTunables(NamedTuple):
    """Shares are of a window's area, scores are correlations of the two images, grid px those of the window's working
    grid (`scene.FINE_PX` a side)."""

    # the first plane of a window
    coarse_px: int = 48  # side of the grid on which planes are searched for; half of it is coarser than the noise
    overview_share: float = 0.25  # covered by overview matches, with which they give the first plane
    part_share: float = 0.1  # matched under that plane, where too little is in image 2 for planes to be compared
    good_score: float = 0.8  # of a plane, with which no other is searched for; below it matches agree poorly
    fair_score: float = 0.3  # below it, what is compared is other ground
    # 1-sigma of a normal fitted to all pixels as if their errors were independent: more, and the window is too bare.
    # Interpolation correlates them, so the true sigma is about 3 times as large
    informed_rad: float = float(np.radians(8.0)) / 3.0

    # dense matches on that plane
    cells_across: int = 16  # along the longer side, as far as cells get no smaller than 4 px
    clear_score: float = 0.95  # of matches that need no smoothing, and are no chance
    flow_floor_px: float = 0.03  # px, 1-sigma: interpolation and quantisation of the flow
    max_sigma_px: float = 0.5  # grid px, 1-sigma: cells matched worse are not used
    least_share: float = 0.04  # matched less, a plane is chance
    same_ground_score: float = 0.5  # below it, parts of two images show different ground
    corner_distance_px: float = 5.0  # grid px between corners; nearer ones are the same

    # 1-sigma of the tilt in addition to what residuals tell
    scarce_share: float = (
        0.3  # matched less, or of less without doubt, a window may tilt otherwise than its matches say
    )
    most_rad: float = float(np.radians(30.0))  # upper bound for a window of which some part is matched
    samples: int = 9  # points a side, on which an unmatched cell is compared with image 2
    amid: float = 0.75  # share of the cells around an unmatched one that, matched, tell more than what lies farther off
    beside: float = 0.25  # longer sides: overview matches as near to an unmatched cell tell its height
    steepest: float = 6.0  # rise per distance of a surface seen beside a window (80 degrees): steeper, it is mismatched
    off_plane: float = 0.45  # longer sides: height of what contradicts the plane, if nothing else tells it
    bend_count: float = 3.0  # weight of the prior bend of the ground, in measured pairs of blocks

    # borrowed planes
    reaches: tuple[float, ...] = (0.75, 1.5, 3.0)  # longer sides around the window, in which matches are looked for
    least_near: int = 20  # matches around the window: fewer do not tell one surface from another
    same_grey: float = 30.0  # grey levels by which one material differs from place to place; more is a thing in the way
    textured_grey: float = 12.0  # standard deviation of grey levels that ought to have been matched
    unexplained_rad: float = float(np.radians(20.0))  # 1-sigma of the tilt of a textured window without matches


TUNE = WindowTunables()
