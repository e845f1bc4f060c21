"""Landing sites: discs of safe ground in a slope map, the largest or the safest first, none over another.

A cell is safe if its probability is at least the confidence; unknown cells and what lies beyond the map are not. The
clearance of a cell is its distance to the nearest cell that is not safe, less half a cell. As the slope of a footprint
concerns all its ground, a cell stands for a disc of safe ground of its clearance and half a footprint.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.ground.footprints import disc_halves
from slopecli.ground.lander import Stand, local_ground, within, worst_stand
from slopecli.ground.slope_map import Site
from slopecli.options import Lander, MapOptions
from slopecli.types import BoolArray, FloatArray, IntArray

MOST_FAILURES = 300  # places where the lander cannot stand before no more are tried: half a second
STEP_OF_FAILURE = 0.125  # of the lander's diameter around such a place, where no other is tried
SURROUNDINGS = 1.2  # radii of the lander around a site whose ground is compared: oblique views stretch a disc


@dataclass(frozen=True, eq=False)
class Ground:
    """What sites are chosen from. Lengths without a suffix are in the unit of the scale, px are of image 1.

    slope_deg, sigma_deg, p_safe, above_plane_max, below_plane_max, step, points : as in `SlopeMap`, (rows, columns).
    surface (h, w, 3) : ground of the pixels of a working grid over all of image 1, camera-1 axes; used where `known`.
    known : (h, w); most pixels of a safe footprint are.
    grid_scale : (2,) px of that grid per px of image 1.  shape1, shape2 : height and width of the images, px.
    up : (3,) unit vector, camera-1 axes.  unit : of lengths, as messages call it.
    pixels2 : (k, 3) points in camera-1 axes -> (k, 2) px of image 2, NaN for those it cannot show.
    R, T : motion, P2 = R (P1 - T).
    """

    slope_deg: FloatArray
    sigma_deg: FloatArray
    p_safe: FloatArray
    above_plane_max: FloatArray
    below_plane_max: FloatArray
    step: BoolArray
    points: FloatArray
    spacing_px: int
    footprint_px: float
    surface: NDArray[np.floating]
    known: BoolArray
    grid_scale: FloatArray
    shape1: tuple[int, int]
    shape2: tuple[int, int]
    up: FloatArray
    confidence: float
    tolerance_rad: float
    max_height: float | None
    pixels2: Callable[[FloatArray], FloatArray]
    R: FloatArray
    T: FloatArray
    unit: str = "m"

    @property
    def safe(self) -> BoolArray:
        """Cells that are known to be safe."""
        return np.asarray(self.p_safe >= self.confidence)

    def centre_px(self, row: int, column: int) -> FloatArray:
        """(2,) centre of a cell, px."""
        return (np.array([column, row]) + 0.5) * self.spacing_px - 0.5

    def disc(self, centre_px: FloatArray, radius_px: float) -> FloatArray:
        """(n, 3) known ground within a radius of a place."""
        part, inside, _ = self._pixels(centre_px, radius_px)
        return self.surface[part][inside].astype(np.float64)

    def pixel_sizes(self, centre_px: FloatArray) -> tuple[float, float]:
        """Least and largest length on the ground, over all directions, of a px of image 1, over a footprint there."""
        radius_px = max(0.5 * self.footprint_px, 2.0 / float(self.grid_scale.min()))
        part, inside, (x, y) = self._pixels(centre_px, radius_px)
        row, column = np.nonzero(inside)
        offsets = np.column_stack([x[column] - x[column].mean(), y[row] - y[row].mean()])
        per_px = np.linalg.solve(offsets.T @ offsets, offsets.T @ self.surface[part][inside].astype(np.float64))
        largest, least = np.linalg.svd(per_px, compute_uv=False)
        return float(least), float(largest)

    def _pixels(
        self, centre_px: FloatArray, radius_px: float
    ) -> tuple[tuple[slice, slice], BoolArray, tuple[FloatArray, FloatArray]]:
        """The part of the grid around a place, which of its pixels are known and within the radius, and where its
        columns and rows are from that place, px of image 1."""
        size = np.array(self.known.shape[::-1])
        middle = (centre_px + 0.5) * self.grid_scale - 0.5
        low = np.clip(np.ceil(middle - radius_px * self.grid_scale), 0, size).astype(int)
        high = np.clip(np.floor(middle + radius_px * self.grid_scale) + 1, 0, size).astype(int)
        x, y = ((np.arange(a, b) - m) / s for a, b, m, s in zip(low, high, middle, self.grid_scale, strict=True))
        part = np.s_[low[1] : high[1], low[0] : high[0]]
        return part, self.known[part] & (x**2 + y[:, None] ** 2 <= radius_px**2), (x, y)


@dataclass(frozen=True)
class Place:
    """A disc around a cell, its radius in px of image 1, and the least probability of the cells in it."""

    row: int
    column: int
    radius_px: float
    p_safe: float


@dataclass(frozen=True)
class Trial:
    """A lander set down at a place: how it stands, None where the disc is smaller than the lander; whether it may.

    px_length : least length on the ground, over all directions, of a px of image 1 there.
    """

    stand: Stand | None
    safe: bool
    px_length: float


class Places:
    """The discs that are still free, and the best of them."""

    def __init__(self, ground: Ground, wanted_px: float | None) -> None:
        self._ground, self._wanted_px = ground, wanted_px
        self._p_safe = np.where(ground.safe, ground.p_safe, 0.0)
        self.radius_px = safe_radii(ground)  # (rows, columns) of the largest free disc around every cell
        self._rank = self._p_safe
        self._room = self.radius_px
        if wanted_px is not None:
            self._rank = least_within(self._p_safe, self._cells(wanted_px))

    def best(self) -> Place | None:
        """The largest disc, of those the safest; or of a wanted radius the safest, of those with the most room."""
        if self._wanted_px is None:
            largest = float(self.radius_px.max(initial=-np.inf))
            if largest < 0.5 * self._ground.footprint_px:
                return None
            row, column = np.nonzero(self.radius_px >= largest - 1e-9)  # but for rounding
            p_safe = least_around(self._p_safe, row, column, self._cells(largest))
            first = int(p_safe.argmax())
            place = int(row[first]), int(column[first])
            return Place(*place, float(self.radius_px[place]), float(p_safe[first]))
        row, column = np.nonzero(self.radius_px >= self._wanted_px)
        if not len(row):
            return None
        first = int(np.lexsort((-self._room[row, column], -self._rank[row, column]))[0])
        place = int(row[first]), int(column[first])
        return Place(*place, self._wanted_px, float(self._rank[place]))

    def take(self, place: Place) -> None:
        """Shrink the discs of all other cells until they do not overlap this one, which is now a site."""
        self.radius_px = np.minimum(self.radius_px, self._apart(place) - place.radius_px)

    def forget(self, place: Place, reach_px: float) -> None:
        """Rule out a cell and those within a reach, px, as sites."""
        self.radius_px = np.where(self._apart(place) <= reach_px, -np.inf, self.radius_px)

    def _apart(self, place: Place) -> FloatArray:
        """(rows, columns) distance of every cell from a place, px."""
        rows, columns = self.radius_px.shape
        away = (np.arange(rows)[:, None] - place.row) ** 2 + (np.arange(columns) - place.column) ** 2
        return self._ground.spacing_px * np.sqrt(away)

    def _cells(self, radius_px: float) -> float:
        """Distance, in cells, within which footprints lie in a disc."""
        return max(radius_px - 0.5 * self._ground.footprint_px, 0.0) / self._ground.spacing_px


def find_sites(ground: Ground, options: MapOptions, radius_px: float | None = None) -> tuple[Site, ...]:
    """Choose up to `options.sites` landing sites, best first; none where no ground is known to be safe.

    Without a radius the largest disc comes first. With one, every disc has that radius, and the safest comes first. A
    place where the lander of the options cannot stand as safely as asked for is left out.
    """
    places = Places(ground, radius_px)
    sites: list[Site] = []
    failures = 0
    while len(sites) < options.sites and failures < MOST_FAILURES:
        place = places.best()
        if place is None:
            break
        stand = None
        if options.lander is not None:
            trial = set_down(ground, place, options.lander)
            if not trial.safe:
                failures += 1
                places.forget(place, STEP_OF_FAILURE * options.lander.diameter / trial.px_length)
                continue
            stand = trial.stand
        sites.append(_measured(ground, place, len(sites) + 1, stand))
        places.take(place)
    return tuple(sites)


def safe_radii(ground: Ground) -> FloatArray:
    """(rows, columns) radius of the disc of safe ground around every cell, px; -inf for cells that are not safe.

    It ends at the border of the image.
    """
    safe = np.pad(ground.safe, 1).astype(np.uint8)
    rounded = cv2.distanceTransform(safe, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1].astype(np.float64)
    cells = np.sqrt(np.rint(rounded**2))  # float32 at first; squares of distances between cells are integers
    radius = (cells - 0.5) * ground.spacing_px + 0.5 * ground.footprint_px
    u, v = ((np.arange(count) + 0.5) * ground.spacing_px for count in ground.safe.shape[::-1])
    border = np.minimum(np.minimum(u, ground.shape1[1] - u), np.minimum(v, ground.shape1[0] - v)[:, None])
    return np.where(ground.safe, np.minimum(radius, border), -np.inf)


def least_within(values: FloatArray, radius: float) -> FloatArray:
    """Least value (rows, columns) within a radius, in cells, of every cell; beyond the border the values are 0."""
    reach, (height, width) = int(radius + 1e-9), values.shape
    rows = np.arange(-reach, reach + 1)
    halves = disc_halves(radius + 1e-9)
    row = np.pad(values, reach)  # least value of a row within as many cells as the loop has come to
    least = np.full(values.shape, np.inf)
    for half in range(reach + 1):
        if half:
            wider = row.copy()
            np.minimum(wider[:, 1:], row[:, :-1], out=wider[:, 1:])
            np.minimum(wider[:, :-1], row[:, 1:], out=wider[:, :-1])
            row = wider
        for dy in rows[halves == half] + reach:
            np.minimum(least, row[dy : dy + height, reach : reach + width], out=least)
    return least


def least_around(values: FloatArray, row: IntArray, column: IntArray, radius: float) -> FloatArray:
    """As `least_within`, for the cells of these rows and columns alone."""
    reach = int(radius + 1e-9)
    rows = np.arange(-reach, reach + 1)
    dy, dx = np.nonzero(np.abs(rows) <= disc_halves(radius + 1e-9)[:, None])
    padded = np.pad(values, reach)
    return np.asarray([padded[y + dy, x + dx].min() for y, x in zip(row, column, strict=True)])


def set_down(ground: Ground, place: Place, lander: Lander) -> Trial:
    """Find how a lander stands at a place, and whether it may."""
    centre_px = ground.centre_px(place.row, place.column)
    least, largest = ground.pixel_sizes(centre_px)
    radius = 0.5 * (lander.diameter + lander.pad)
    if place.radius_px * least < radius:
        return Trial(None, False, least)
    pixel = largest / float(ground.grid_scale.min())
    points = ground.disc(centre_px, SURROUNDINGS * (radius + pixel) / least)
    around = local_ground(points, ground.points[place.row, place.column], ground.up)
    stand = worst_stand(lander, around[within(around, radius + pixel)], pixel)
    low = ground.max_height is None or stand.clearance <= ground.max_height
    return Trial(stand, low and stand.slope_rad <= ground.tolerance_rad, least)


def _measured(ground: Ground, place: Place, number: int, stand: Stand | None) -> Site:
    centre_px, centre = ground.centre_px(place.row, place.column), ground.points[place.row, place.column]
    points = ground.disc(centre_px, place.radius_px)
    normal, heights = plane_of(points)
    from_camera2 = ground.R @ (centre - ground.T)
    return Site(
        id=number,
        centre_px=(float(centre_px[0]), float(centre_px[1])),
        radius_px=place.radius_px,
        radius=place.radius_px * ground.pixel_sizes(centre_px)[0],
        slope_deg=math.degrees(math.atan2(float(np.linalg.norm(np.cross(normal, ground.up))), normal @ ground.up)),
        slope_sigma_deg=_largest_sigma(ground, place),
        above_plane_max=max(float(heights.max()), 0.0),
        below_plane_max=max(float(-heights.min()), 0.0),
        p_safe=place.p_safe,
        verdict="safe",
        centre_image2_px=_in_image2(ground, centre),
        direction_cam1=_unit(centre),
        direction_cam2=_unit(from_camera2),
        lander_slope_deg=None if stand is None else math.degrees(stand.slope_rad),
        lander_clearance=None if stand is None else stand.clearance,
    )


def plane_of(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Plane of the least squared distances: (3,) unit normal on the side of camera 1, and (n,) heights over it."""
    middle = points.mean(axis=0)
    offsets = points - middle
    normal = np.linalg.eigh(offsets.T @ offsets)[1][:, 0]
    normal = -normal if normal @ middle > 0 else normal
    return normal, np.asarray(offsets @ normal)


def _largest_sigma(ground: Ground, place: Place) -> float:
    """Largest 1-sigma of the slopes of the footprints in a disc, deg."""
    reach = max(place.radius_px - 0.5 * ground.footprint_px, 0.0) / ground.spacing_px
    cell = np.array([place.row]), np.array([place.column])
    return -float(least_around(np.where(ground.safe, -ground.sigma_deg, 0.0), *cell, reach)[0])


def _in_image2(ground: Ground, point: FloatArray) -> tuple[float, float] | None:
    """Px of a point in image 2; None where image 2 does not show it."""
    u, v = (float(value) for value in ground.pixels2(point[None])[0])
    height, width = ground.shape2
    shown = -0.5 <= u < width - 0.5 and -0.5 <= v < height - 0.5  # false for NaN
    return (u, v) if shown else None


def _unit(vector: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in vector / np.linalg.norm(vector))
    return x, y, z
