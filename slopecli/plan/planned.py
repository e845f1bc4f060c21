"""Options of a plan, and the plan itself as it is written and shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from slopecli.plan.baseline import Of
from slopecli.plan.flight import NOISE_PX, POINTS, ROUGHNESS, Window
from slopecli.types import Camera, Diagnostic, Up

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
    roughness: float = ROUGHNESS
    points: int = POINTS
    noise_px: float = NOISE_PX
    up: str | Vector = "camera"
    up_sigma_deg: float = 0.0
    north: Vector | None = None


@dataclass(frozen=True)
class Ground:
    slope_deg: float
    aspect_deg: float
    uneven_deg: float
    roughness: float


@dataclass(frozen=True)
class Wanted:
    """The sigma the baseline was asked for."""

    sigma_deg: float
    of: Of


@dataclass(frozen=True)
class SecondAnswer:
    """share: of the simulated pairs that have two answers. All sigmas are those of the right one.

    first_error_deg : RMS error of the slopes, in the median window, of whoever takes the first answer all the same.
    """

    likely: bool
    share: float
    first_error_deg: float | None


@dataclass(frozen=True)
class PlannedWindow:
    """window: x, y, w, h px of image 1. share_in_image2: of its points. What is not known is None.

    unseen_deg : 1-sigma that `estimate` adds, in quadrature, for what image 2 does not show of it.
    """

    id: int
    window: Window
    slope_sigma_deg: float | None
    parallax_px: float | None
    share_in_image2: float
    status: Literal["ok", "poor", "refused"]
    reason: str | None = None
    unseen_deg: float | None = None

    @property
    def in_part(self) -> bool:
        """Whether `estimate` will add (in quadrature) more than half of its sigma, for what image 2 does not show."""
        return self.slope_sigma_deg is not None and (self.unseen_deg or 0.0) > 0.5 * self.slope_sigma_deg


@dataclass(frozen=True, eq=False)
class Plan:
    """What plan.json, plan.png and the table are made from; lengths in `unit`."""

    camera: Camera
    up: Up
    ground: Ground
    direction_cam1: Vector
    unit: Literal["m", "baseline", "height"]
    height: float
    baseline: float
    points: int
    noise_px: float
    wanted: Wanted | None
    worst_sigma_deg: float | None
    median_sigma_deg: float | None
    sigma_source: Literal["covariance", "simulation"]
    parallax_px: float
    zoom: float
    second_answer: SecondAnswer
    windows: tuple[PlannedWindow, ...]
    diagnostics: tuple[Diagnostic, ...]
    epipole1_px: tuple[float, float] | None = None


def sigma_text(sigma_deg: float | None) -> str:
    """Two figures of a sigma: "0.034°", "1.2°", "14°"; "-" for none."""
    if sigma_deg is None:
        return "-"
    if sigma_deg < 0.0995:
        return f"{sigma_deg:.2g}°"
    digits = 2 if sigma_deg < 0.995 else 1 if sigma_deg < 9.95 else 0
    return f"{sigma_deg:.{digits}f}°"
