"""Why a map has no landing site: what came nearest to one, and what it lacks."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from slopecli.ground.cell_map import WITHHELD
from slopecli.ground.sites import Ground, Places, safe_radii, set_down
from slopecli.options import Lander, MapOptions


def nearest_miss(ground: Ground, options: MapOptions, radius_px: float | None = None) -> str:
    """One sentence on a map in which `find_sites` finds no site with the same arguments."""
    if not np.isfinite(ground.p_safe).any():
        return "no ground is known: no footprint has enough pixels that are matched"
    if not ground.safe.any():
        return _best_cell(ground)
    radii = safe_radii(ground)
    row, column = (int(i) for i in np.unravel_index(radii.argmax(), radii.shape))
    largest, least = float(radii[row, column]), radius_px or 0.5 * ground.footprint_px
    if largest < least:
        than = "that are wanted" if radius_px is not None else "of a footprint, which reaches beyond the image"
        return (
            f"the largest disc of safe ground, at {_at(ground, row, column)}, has a radius of {largest:.4g} px, less "
            f"than the {least:.4g} px {than}"
        )
    return _no_stand(ground, radius_px, options.lander) if options.lander else "no site was asked for"


def _best_cell(ground: Ground) -> str:
    row, column = (int(i) for i in np.unravel_index(np.nanargmax(ground.p_safe), ground.p_safe.shape))
    slope, sigma = float(ground.slope_deg[row, column]), float(ground.sigma_deg[row, column])
    return (
        f"the footprint that came nearest, at {_at(ground, row, column)}, has a slope of {slope:.1f} deg, 1-sigma "
        f"{sigma:.2g} deg, and is safe with a probability of {_short(float(ground.p_safe[row, column]))}, less than "
        f"{ground.confidence:g}: {_lack(ground, row, column)}"
    )


def _lack(ground: Ground, row: int, column: int) -> str:
    """What keeps a footprint from being safe."""
    tolerance = math.degrees(ground.tolerance_rad)
    slope, sigma = float(ground.slope_deg[row, column]), float(ground.sigma_deg[row, column])
    if ground.step[row, column]:
        return "it lies across a step of the ground"
    if slope >= tolerance:
        return f"it is steeper than {tolerance:g} deg"
    above, below = float(ground.above_plane_max[row, column]), float(ground.below_plane_max[row, column])
    if ground.max_height is not None and max(above, below) > ground.max_height:
        where = f"stands {above:.3g} {ground.unit} above" if above >= below else f"lies {below:.3g} {ground.unit} below"
        return f"something {where} its plane, more than {ground.max_height:g}"
    gentle = NormalDist().cdf((tolerance - slope) / max(sigma, 1e-9))
    if gentle >= ground.confidence and ground.p_safe[row, column] <= WITHHELD:
        return "ground that was not matched, or is not in both images, lies beside it"
    if ground.max_height is None or gentle < ground.confidence:
        return f"its slope is not known well enough to be below {tolerance:g} deg"
    return (
        f"its heights, up to {max(above, below):.3g} {ground.unit}, are not known well enough to be below "
        f"{ground.max_height:g}"
    )


def _no_stand(ground: Ground, radius_px: float | None, lander: Lander) -> str:
    """What keeps the lander from the best disc of safe ground."""
    place = Places(ground, radius_px).best()
    if place is None:
        return "no disc of safe ground is large enough"
    trial = set_down(ground, place, lander)
    where = f"the best disc of safe ground, at {_at(ground, place.row, place.column)},"
    stand = trial.stand
    if stand is None:
        radius = place.radius_px * trial.px_length
        return (
            f"{where} has a radius of {radius:.3g} {ground.unit}, less than that of the lander, "
            f"{0.5 * (lander.diameter + lander.pad):.3g}"
        )
    slope, tolerance = math.degrees(stand.slope_rad), math.degrees(ground.tolerance_rad)
    if stand.slope_rad > ground.tolerance_rad:
        return f"{where} has a heading in which the lander stands at {slope:.1f} deg, more than {tolerance:g}"
    return (
        f"{where} has a heading in which ground stands {stand.clearance:.3g} {ground.unit} above the plane of the "
        f"lander's pads, more than {ground.max_height:g}"
    )


def _at(ground: Ground, row: int, column: int) -> str:
    u, v = ground.centre_px(row, column)
    return f"({u:g}, {v:g}) px"


def _short(probability: float) -> str:
    """A probability rounded down, so that it does not look like one that suffices."""
    return f"{math.floor(1000.0 * probability) / 1000.0:g}"
