"""Predicted 1-sigma of the slope of a map's footprint, a disc of ground, by the noise of dense matching.

Every pixel has an inverse depth w whose logarithm errs by n / s: n px is the noise of its match, s px the shift of the
pixel in image 1 per unit of ln w. Neighbours share their errors over an area A: sums of errors have A times the
variance of independent ones. A ramp g fitted to ln w over a disc of diameter D px, with x the distance from its middle
along one axis, is sum(e x) / sum(x^2), and sum(x^2) = pi D^4 / 64. So its 1-sigma is

    (n / s) sqrt(A) / sqrt(pi D^4 / 64) = (n / s) sqrt(A) 8 / (sqrt(pi) D^2) a px,

times the focal length per normalised coordinate. About a ray x, N = w (g, 1 - g.x) is the scaled normal of the plane.
The alignment smooths over a Gaussian window of sigma q px, which leaves noise of A = 4 pi q^2. Noise that is shared
across the rim of a disc counts for less, which is left out: with D = 60 px this is 14 % too much.
"""

from __future__ import annotations

import numpy as np

from slopecli.geometry.epipolar import homogeneous
from slopecli.ground.cell_grid import choose_cells
from slopecli.ground.safety import tilts
from slopecli.look.dense_depth import DEPTH
from slopecli.options import MOST_SIGMA_DEG
from slopecli.plan.flight import Flight, horizontal, in_image2
from slopecli.types import FloatArray

PIXEL_NOISE = 1.8  # n over the noise of a match as `estimate` reports it, measured on sample_data/descent


def footprint_of(flight: Flight, footprint_px: float | None) -> float:
    """Diameter of the footprints of a map, px of image 1: the one given, or the default.

    Raises
    ------
    InputError : it is too small or too large for the image.
    """
    camera = flight.camera
    return choose_cells(camera.width, camera.height, _shrunk(flight), footprint_px, None).footprint_px


def footprint_sigmas(flight: Flight, baseline: float, footprint_px: float) -> FloatArray:
    """(m,) 1-sigma of the slope of a footprint in the middle of every window, rad; NaN where image 2 does not show it.

    baseline : in heights.  footprint_px : diameter, px of image 1.
    """
    shown = in_image2(flight, baseline)
    middle = np.abs(np.stack([flight.places(k) for k in range(len(shown))])).sum(-1).argmin(axis=1)
    each = np.arange(len(shown))
    x = np.where(shown[each, middle, None], flight.rays[each, middle], 0.0)
    normals = flight.normals * baseline
    w = np.where(shown[each, middle], (homogeneous(x) * normals).sum(-1), 1e-3)
    # of x2 = (x - w T) / (1 - w T_z), a change with ln w as a change of x
    shift = w[:, None] * (x * flight.T[2] - flight.T[:2]) / (1.0 - w * flight.T[2])[:, None]
    shift_px = np.maximum(flight.camera.focal_px * np.linalg.norm(shift, axis=1), 1e-9)  # 0 where the camera heads for
    error = PIXEL_NOISE * flight.noise_px / shift_px
    area, diameter = 4.0 * np.pi * DEPTH.window_px**2, footprint_px * _shrunk(flight)
    per_px = error * np.sqrt(area) * 8.0 / (np.sqrt(np.pi) * diameter**2)
    gradient = per_px * flight.camera.focal_px * _shrunk(flight)
    spread = w[:, None, None] * np.concatenate([np.broadcast_to(np.eye(2), (len(x), 2, 2)), -x[:, None, :]], axis=1)
    covariance = gradient[:, None, None] ** 2 * spread @ spread.swapaxes(1, 2)
    north = horizontal(flight.up, 0.0)
    sigma = tilts(normals, covariance, flight.up, flight.up_sigma_rad, north).sigma_rad
    return np.where(shown[each, middle] & (sigma <= np.radians(MOST_SIGMA_DEG)), sigma, np.nan)


def _shrunk(flight: Flight) -> float:
    """Px of the working grid of a map per px of image 1."""
    return float(min(1.0, DEPTH.most_pixels / (flight.camera.width * flight.camera.height)) ** 0.5)
