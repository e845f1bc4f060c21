"""A plan as it is written and shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from slopecli.plan.flight import Window
from slopecli.plan.plan_options import Of, Vector
from slopecli.types import Camera, Diagnostic, Up


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
