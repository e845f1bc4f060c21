"""Options of a plan, with their defaults. Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Of = Literal["worst", "median"]
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class PlanOptions:
    """What is planned. Of direction and trajectory one is given, of baseline and sigma at most one.

    direction : from camera 1 to camera 2, camera-1 axes.  trajectory_deg : instead, of the flight from the vertical, as
        in the paper: 0 descends, 45 glides, 90 flies level, towards the image's right.
    height : of camera 1 above the ground, and baseline: m. Without a baseline the height is in baselines; with sigma,
        which asks for the baseline, it may be left out: lengths are in heights then.
    slope_deg, aspect_deg : of the ground, the latter its way down, from north.  uneven_deg : by how much each window's
        plane tilts from it.  The rest as in `Flight` and `Options`.
    """

    direction: Vector | None = None
    trajectory_deg: float | None = None
    height: float | None = None
    baseline: float | None = None
    sigma_deg: float | None = None
    of: Of = "worst"
    slope_deg: float = 0.0
    aspect_deg: float = 0.0
    uneven_deg: float = 0.0
    # natural ground: estimate reports 0.001 to 0.005, more among rocks, 0 on pavement
    roughness: float = 0.002
    points: int = 100  # a window; estimate finds 300 to 400, of which about four share their errors
    footprint_px: float | None = None  # diameter of a disc of `slopemap map`; None: its default
    noise_px: float = 0.1  # estimate measures 0.03 to 0.1 in rendered images, 0.1 to 0.3 in photographs
    up: str | Vector = "camera"
    up_sigma_deg: float = 0.0
    north: Vector | None = None
