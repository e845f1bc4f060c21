"""Geometry of two images still to be taken: camera, direction of motion, ground, and the points that both will show.

Lengths are in heights of camera 1 above the ground; camera 2 keeps the attitude of camera 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from slopecli.errors import InputError, NoAnswer
from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous, unit_vector
from slopecli.geometry.plane_fit import BEND_RAD, lever
from slopecli.geometry.solver.observations import Prediction, observe, predict
from slopecli.look.matches import MIN_ON_PLANE
from slopecli.patches.windows.tunables import TUNE
from slopecli.plan.plan_options import PlanOptions
from slopecli.types import BoolArray, Camera, FloatArray, IntArray

Window = tuple[int, int, int, int]  # x, y, width, height in px of image 1

LEAST_SHARE = TUNE.least_share  # of a window that image 2 must show for an answer, as estimate needs


@dataclass(frozen=True, eq=False)
class Flight:
    """Two images to be taken, but for how far apart.

    Attributes
    ----------
    camera : of both images.  windows : (x, y, w, h) px of image 1.
    direction : (3,) from camera 1 to camera 2, camera-1 axes, any length.
    normals : (m, 3) plane of each window as the solver has it, N.P = 1 for its points P in heights.
    up : (3,) against gravity, camera-1 axes.  up_sigma_rad : its 1-sigma.
    points : independent matches a window.  noise_px : 1-sigma of a coordinate in image 2.
    roughness : RMS height of the ground off the plane of a window, over its distance.
    """

    camera: Camera
    windows: Sequence[Window]
    direction: FloatArray
    normals: FloatArray
    up: FloatArray
    up_sigma_rad: float = 0.0
    points: int = PlanOptions.points
    noise_px: float = PlanOptions.noise_px
    roughness: float = PlanOptions.roughness

    @cached_property
    def T(self) -> FloatArray:
        """(3,) unit vector from camera 1 to camera 2."""
        return unit_vector(np.asarray(self.direction, float))

    @cached_property
    def rays(self) -> FloatArray:
        """(m, lattice, 2) normalised coordinates of points in every window; NaN where there is no ray."""
        uv = np.concatenate([_lattice(window, self.lattice) for window in self.windows])
        return rays_from_pixels(self.camera, uv).reshape(len(self.windows), -1, 2)

    def places(self, window: int) -> FloatArray:
        """(lattice, 2) px of the points of a window from its middle."""
        return _lattice(self.windows[window], self.lattice) - _middle(self.windows[window])

    @property
    def lattice(self) -> int:
        """How many points stand for the matches of a window."""
        return int(np.clip(60_000 // len(self.windows), 32, 256))  # fewer where there are many windows

    @property
    def more(self) -> float:
        """How much more a point of the lattice errs than a match, so that all of them tell as much as the matches."""
        return float(np.sqrt(self.lattice / self.points))


class Seen(NamedTuple):
    """What both images see: points x1, x2 (n, 2) without noise; patch (n,) their place in `windows`, the windows that
    can be answered; share (m,) of every window in image 2; scaled normals of `windows`; weight (n,) of points, for the
    matches of a window are not spread evenly; and the solver's prediction."""

    x1: FloatArray
    x2: FloatArray
    patch: IntArray
    windows: IntArray
    share: FloatArray
    normals: FloatArray
    weight: FloatArray
    prediction: Prediction


def ground_normals(
    camera: Camera, windows: Sequence[Window], up: FloatArray, slope_rad: float, downhill: FloatArray, uneven_rad: float
) -> FloatArray:
    """(m, 3) planes of windows, N.P = 1 in heights, of ground one height below the camera.

    Parameters
    ----------
    up : (3,) unit vector.  downhill : (3,) horizontal unit vector the ground falls to, by `slope_rad` (below pi/2).
    uneven_rad : angle between each window's plane and the ground, each in a direction of its own about the middle of
        the window; 0 for windows that all lie on one plane.
    """
    outward = np.cos(slope_rad) * up + np.sin(slope_rad) * downhill
    ground = -outward / np.cos(slope_rad)
    across = np.cross(outward, np.cross(up, downhill))
    turn = np.arange(len(windows)) * np.pi * (3.0 - np.sqrt(5.0))  # the golden angle: no two directions alike
    lean = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * np.cross(outward, across)
    normals = -(np.cos(uneven_rad) * outward + np.sin(uneven_rad) * lean)
    middles = homogeneous(rays_from_pixels(camera, np.array([_middle(window) for window in windows])))
    depth_inverse = middles @ ground
    seen = depth_inverse > 0.0  # False for NaN; beyond the horizon there is nothing to tilt
    scale = np.where(seen, depth_inverse, 1.0) / np.where(seen, np.sum(normals * middles, axis=1), 1.0)
    return np.where(seen[:, None], normals * scale[:, None], ground)


def horizontal(up: FloatArray, azimuth_rad: float, north: FloatArray | None = None) -> FloatArray:
    """(3,) horizontal unit vector at an azimuth, clockwise seen from above, from north or the image's up direction.

    up : (3,) unit vector. With a camera that looks at the horizon the image's up direction is none, and azimuths count
    from the viewing direction.

    Raises
    ------
    InputError : north is vertical.
    """
    for given in (np.array([0.0, -1.0, 0.0]), np.array([0.0, 0.0, 1.0])) if north is None else (np.array(north),):
        level = unit_vector(given)
        level = level - (level @ up) * up
        if np.linalg.norm(level) > 1e-6:
            level = level / np.linalg.norm(level)
            return np.asarray(np.cos(azimuth_rad) * level + np.sin(azimuth_rad) * np.cross(level, up))
    raise InputError("north is vertical, so it gives no horizontal direction; give another north")


def in_image2(flight: Flight, baseline: float) -> BoolArray:
    """(m, lattice) whether points of windows lie on ground in front of camera 1 and within image 2."""
    camera, p = flight.camera, homogeneous(flight.rays.reshape(-1, 2))
    normals = np.repeat(flight.normals * baseline, flight.lattice, axis=0)
    inverse_depth = np.sum(normals * p, axis=1)
    y = p - inverse_depth[:, None] * flight.T
    ahead = (inverse_depth > 0.0) & (y[:, 2] > 1e-6)  # False for NaN, too
    x2 = np.where(ahead[:, None], y[:, :2] / np.where(ahead, y[:, 2], 1.0)[:, None], 0.0)
    u, v = pixels_from_rays(camera, x2).T
    inside = ahead & (u >= -0.5) & (u < camera.width - 0.5) & (v >= -0.5) & (v < camera.height - 0.5)
    return np.asarray(inside.reshape(len(flight.windows), -1))


def refuse_sky(flight: Flight) -> None:
    """Raise NoAnswer where no window has ground before camera 1, but the sky: most often up points the wrong way."""
    rays = np.nan_to_num(flight.rays)
    ahead = (homogeneous(rays.reshape(-1, 2)).reshape(*rays.shape[:2], 3) @ flight.normals[:, :, None])[..., 0] > 0.0
    if not (ahead & np.isfinite(flight.rays).all(axis=2)).any():
        raise NoAnswer(
            "no-overlap",
            f"with this up none of the {len(flight.windows)} windows looks at the ground: all are above the horizon",
            "turn the sign of --up round if it points down (of a camera that looks straight down it is 0,0,-1), or "
            "turn the camera to the ground",
        )


def see(flight: Flight, baseline: float) -> Seen:
    """Which points of the lattice both images see, and where."""
    m, n = flight.rays.shape[:2]
    rays, patch = flight.rays.reshape(-1, 2), np.repeat(np.arange(m), n)
    inside = in_image2(flight, baseline)
    share = inside.mean(axis=1)
    windows = np.flatnonzero((share >= LEAST_SHARE) & (share * flight.points >= MIN_ON_PLANE))
    used = inside.ravel() & np.isin(patch, windows)
    x1, patch = rays[used], np.searchsorted(windows, patch[used])
    normals = (flight.normals * baseline)[windows]
    if len(windows):
        blank = observe(x1, np.zeros_like(x1), patch)
        prediction = predict(blank, np.eye(3)[None], flight.T[None], normals[None])
    else:
        prediction = Prediction(*(np.zeros((1, 2, 0)) for _ in Prediction._fields))
    # n matches at random places tell as much as n - 3 that are spread evenly
    weight = (1.0 - 3.0 / (share[windows] * flight.points))[patch]
    return Seen(x1, prediction.x2[0].T, patch, windows, share, normals, weight, prediction)


def _lattice(window: Window, size: int) -> FloatArray:
    """(size, 2) px, evenly over a window and in no rows, so that what an image border cuts off counts right.

    Source: Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018; steps of the plastic number.
    """
    x, y, w, h = window
    steps = (0.5 + np.arange(1, size + 1)[:, None] * [0.7548776662466927, 0.5698402909980532]) % 1.0
    return np.asarray([x - 0.5, y - 0.5] + steps * [w, h])


def _middle(window: Window) -> list[float]:
    x, y, w, h = window
    return [x - 0.5 + 0.5 * w, y - 0.5 + 0.5 * h]


def unseen_tilts(flight: Flight, baseline: float) -> FloatArray:
    """(m,) 1-sigma of the tilt of windows due to their part outside image 2, rad; baseline in heights.

    Parts that will be hidden or without texture are not known beforehand.
    """
    inside = in_image2(flight, baseline)
    return BEND_RAD * np.array([lever(flight.places(i), inside[i]) for i in range(len(inside))])
