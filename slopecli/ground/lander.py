"""A lander on its pads over measured ground: the steepest it stands in any heading, and what stands up under it.

Coordinates of the ground around a site are (east, north, height): two horizontal axes and the one along up, in the
unit of the scale, from the centre of the site.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from slopecli.geometry.epipolar import tangent_basis
from slopecli.options import Lander
from slopecli.types import BoolArray, FloatArray

HEADING_STEP_DEG = 5.0  # largest step between the headings that are tried


@dataclass(frozen=True)
class Stand:
    """Worst stands of a lander over all headings: slope of the plane of its pads, and highest ground above that plane
    (0 where none is) under the lander, in the unit of the scale."""

    slope_rad: float
    clearance: float


def local_ground(points: FloatArray, centre: FloatArray, up: FloatArray) -> FloatArray:
    """(n, 3) points in camera-1 axes as (east, north, height) from the centre of a site; up (3,) a unit vector."""
    return np.asarray((points - centre) @ np.column_stack([tangent_basis(up), up]))


def worst_stand(lander: Lander, ground: FloatArray, pixel: float) -> Stand:
    """Let a lander stand on the ground in all headings, HEADING_STEP_DEG or less apart.

    Pads are `diameter / 2` from the centre, equally spaced; each rests on the highest ground under it. A lander with
    more than three pads rests on three between which its centre lies, with no other pad's ground above their plane;
    where several triples are such, it may tilt from one to the other, and all count.

    ground : (n, 3) east, north, height; what lies under the lander.  pixel : distance between its points.
    """
    angles = 2.0 * np.pi * np.arange(lander.pads) / lander.pads
    pads = 0.5 * lander.diameter * np.column_stack([np.cos(angles), np.sin(angles)])
    turns = _headings(lander.pads)
    under = np.hypot(ground[:, 0], ground[:, 1]) <= 0.5 * lander.diameter
    resting = _resting_heights(lander, pads, turns, ground, pixel)
    slope, clearance = 0.0, 0.0
    for three in _supporting_triples(pads):
        planes = resting[:, three] @ np.linalg.inv(np.column_stack([pads[list(three)], np.ones(3)])).T
        others = resting - (planes[:, :2] @ pads.T + planes[:, 2:])
        stable = (others <= 1e-9 * lander.diameter).all(axis=1)  # but for rounding
        if stable.any():
            gradient = np.linalg.norm(planes[stable, :2], axis=1)
            slope = max(slope, math.atan(float(gradient.max())))
            clearance = max(clearance, _highest(ground[under], planes[stable], turns[stable]))
    return Stand(slope, clearance)


def _headings(pads: int) -> FloatArray:
    """(m, 2, 2) rotations of the lander up to that which puts every pad in the place of the next."""
    count = math.ceil(360.0 / pads / HEADING_STEP_DEG - 1e-9)
    angle = 2.0 * np.pi / pads * np.arange(count) / count
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([cosine, -sine], -1), np.stack([sine, cosine], -1)], -2)


def _supporting_triples(pads: FloatArray) -> list[tuple[int, int, int]]:
    """Triples of pads (k, 2) whose triangle holds the centre, or touches it."""

    def holds_centre(three: tuple[int, ...]) -> bool:
        a, b, c = pads[list(three)]
        turns = [p[0] * q[1] - p[1] * q[0] for p, q in ((a, b), (b, c), (c, a))]
        return min(turns) >= -1e-9 * max(turns)

    return [(i, j, k) for i, j, k in combinations(range(len(pads)), 3) if holds_centre((i, j, k))]


def _resting_heights(
    lander: Lander, pads: FloatArray, turns: FloatArray, ground: FloatArray, pixel: float
) -> FloatArray:
    """(m, k) height of the highest ground under every pad in every heading.

    That is the ground within the pad's radius or a pixel of its middle, whichever is more; where a pad stands on an
    unmatched speck, it is the ground nearest to it, and what lies a pixel further.
    """
    places = (turns @ pads.T).swapaxes(1, 2).reshape(-1, 2)
    radius = max(0.5 * lander.pad, pixel)
    ring = np.abs(np.hypot(ground[:, 0], ground[:, 1]) - 0.5 * lander.diameter) <= radius
    heights = _highest_near(places, ground[ring], np.full(len(places), radius**2))
    bare = np.flatnonzero(np.isinf(heights))
    if len(bare):
        nearest = np.sqrt(_squared_distances(places[bare], ground).min(axis=1))
        heights[bare] = _highest_near(places[bare], ground, (nearest + pixel) ** 2)
    return heights.reshape(len(turns), len(pads))


def _highest_near(places: FloatArray, ground: FloatArray, squared_reach: FloatArray) -> FloatArray:
    """(m,) largest height of ground within the reach of each place; -inf where there is none."""
    near = _squared_distances(places, ground) <= squared_reach[:, None]
    return np.asarray(np.where(near, ground[:, 2], -np.inf).max(axis=1, initial=-np.inf))


def _squared_distances(places: FloatArray, ground: FloatArray) -> FloatArray:
    """(m, n) between places (m, 2) and ground (n, 3), horizontally."""
    apart: FloatArray = places[:, :1] - ground[:, 0]
    apart *= apart
    north = places[:, 1:] - ground[:, 1]
    north *= north
    apart += north
    return apart


def _highest(ground: FloatArray, planes: FloatArray, turns: FloatArray) -> float:
    """Largest height of ground (n, 3) above planes (m, 3), height = a x + b y + c in the axes of turned landers."""
    gradient = (turns @ planes[:, :2, None])[..., 0]
    below = np.column_stack([gradient, planes[:, 2], -np.ones(len(planes))])  # times (x, y, 1, height)
    above = -(below @ np.vstack([ground[:, :2].T, np.ones(len(ground)), ground[:, 2]])).min(axis=1, initial=0.0)
    return float((above / np.hypot(1.0, np.linalg.norm(gradient, axis=1))).max())


def within(ground: FloatArray, radius: float) -> BoolArray:
    """Which points (n, 3), east, north, height, lie within a horizontal distance of the centre."""
    return np.asarray(np.hypot(ground[:, 0], ground[:, 1]) <= radius)
