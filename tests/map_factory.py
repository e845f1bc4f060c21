"""Slope maps made from plain arrays, for tests of what is drawn and written from them."""

from __future__ import annotations

from statistics import NormalDist

import numpy as np
from report_factory import make_camera, make_report

from slopecli.geometry import rays_from_pixels
from slopecli.ground import Site, SlopeMap
from slopecli.types import Report, Scale

SPACING_PX = 8
FOOTPRINT_PX = 40.0
METRES = 0.05  # on the ground per px in the middle
TOLERANCE_DEG, CONFIDENCE = 15.0, 0.99


def make_map(slope_deg: np.ndarray, sigma_deg: np.ndarray | float = 0.5, **changes: object) -> SlopeMap:
    """A map of level extent over camera 1, one cell for every slope; NaN for what is not known.

    `changes` replace fields; the chance to be safe follows from the slope and its sigma unless given.
    """
    slope = np.asarray(slope_deg, float)
    known = np.isfinite(slope)
    sigma = np.where(known, sigma_deg, np.nan)
    rows, columns = slope.shape
    spacing = int(changes.get("spacing_px", SPACING_PX))  # type: ignore[call-overload]
    report = changes.pop("report", None) or metric_report(columns * spacing, rows * spacing)
    camera = report.cameras[0]  # type: ignore[attr-defined]
    height = METRES * camera.focal_px
    v, u = (np.indices(slope.shape) + 0.5) * spacing - 0.5
    rays = rays_from_pixels(camera, np.column_stack([u.ravel(), v.ravel()])).reshape(rows, columns, 2)
    points = np.where(known[..., None], height * np.dstack([rays, np.ones(slope.shape)]), np.nan)
    chance = np.vectorize(lambda z: NormalDist().cdf(z))(np.nan_to_num((TOLERANCE_DEG - slope) / sigma))
    flat = np.where(known, 0.01, np.nan)
    fields: dict[str, object] = {
        "slope_deg": slope,
        "sigma_deg": sigma,
        "p_safe": np.where(known, chance, np.nan),
        "aspect_deg": np.where(known & (slope > 2 * sigma), 90.0, np.nan),
        "roughness": flat,
        "above_plane_max": 4 * flat,
        "below_plane_max": 3 * flat,
        "distance": np.linalg.norm(points, axis=2),
        "valid_share": np.where(known, 1.0, 0.4),
        "step": np.zeros(slope.shape, bool),
        "spacing_px": spacing,
        "footprint_px": FOOTPRINT_PX,
        "footprint": METRES * FOOTPRINT_PX,
        "tolerance_deg": TOLERANCE_DEG,
        "confidence": CONFIDENCE,
        "classes_deg": (5.0, 10.0, 15.0, 20.0, 30.0),
        "sites": (),
        "no_site": "",
        "north_cam1": None,
        "report": report,
        "points": points,
    }
    return SlopeMap(**{**fields, **changes})  # type: ignore[arg-type]


def metric_report(width: int, height: int, **changes: object) -> Report:
    """A report without planes whose lengths are metres."""
    camera = make_camera(width, height)
    fields: dict[str, object] = {"planes": (), "rejected": (), "scale": Scale("m", "altitude", 0.01)}
    return make_report(camera, [], **{**fields, **changes})


def make_site(number: int, centre_px: tuple[float, float], radius_px: float, **changes: object) -> Site:
    fields: dict[str, object] = {
        "id": number,
        "centre_px": centre_px,
        "radius_px": radius_px,
        "radius": METRES * radius_px,
        "slope_deg": 3.2,
        "slope_sigma_deg": 0.4,
        "above_plane_max": 0.05,
        "below_plane_max": 0.04,
        "p_safe": 0.998,
        "verdict": "safe",
        "centre_image2_px": None,
        "direction_cam1": (0.0, 0.0, 1.0),
        "direction_cam2": None,
    }
    return Site(**{**fields, **changes})  # type: ignore[arg-type]
