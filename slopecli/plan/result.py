"""From what is planned, in plain numbers, to what is written and shown: the plan of one pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from slopecli.errors import InputError, NoAnswer
from slopecli.findings.parallax import LOW_PARALLAX_PX
from slopecli.findings.wording import beside, finding
from slopecli.geometry.camera import pixels_from_rays
from slopecli.geometry.epipolar import focus_of_expansion, unit_vector
from slopecli.geometry.slope import CAMERA_UP
from slopecli.options import Options
from slopecli.plan.baseline import HALF_SEEN, Of, needed_baseline, sigma_of
from slopecli.plan.flight import (
    LEAST_SHARE,
    NOISE_PX,
    POINTS,
    ROUGHNESS,
    Flight,
    Window,
    ground_normals,
    horizontal,
)
from slopecli.plan.prediction import TRIALS, Forecast, forecast
from slopecli.types import Camera, Diagnostic, FloatArray, Up

LIKELY = 0.5  # share of simulated pairs with two answers from which they are called likely
LARGEST_ZOOM = 2.0  # scale between the images beyond which features are matched badly
VAGUE_DEG = Options().max_sigma_deg
COUNTS = 0.5  # of the sigma: what is added in quadrature, and less than this, makes little of it
TOLERATED = 0.01  # share of the sigma asked for by which the one found may miss it
ROUNDING = 1e-12  # what is left of sines and cosines that are zero
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
        """Whether what image 2 does not show makes much of the sigma that `estimate` will report."""
        return self.slope_sigma_deg is not None and (self.unseen_deg or 0.0) > COUNTS * self.slope_sigma_deg


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


def make_plan(camera: Camera, windows: Sequence[Window], options: PlanOptions) -> Plan:
    """Predict what a pair tells of the slopes in windows, or find the baseline for a wanted sigma.

    Raises
    ------
    InputError : options are missing or contradict each other, or north is vertical.
    NoAnswer : the pair would be refused, or no baseline gives the sigma.
    """
    flight = _flight(camera, windows, options)
    unit, height, baseline = _lengths(options)
    if options.sigma_deg is not None:
        baseline = height * _baseline_for(flight, float(np.radians(options.sigma_deg)), options.of)
    cast = forecast(flight, baseline / height)
    focus = _focus(flight)
    planned = tuple(_window(i, flight, cast) for i in range(len(windows)))
    return Plan(
        camera=camera,
        up=Up(_vector(flight.up), "camera" if options.up == "camera" else "given", options.up_sigma_deg),
        ground=Ground(options.slope_deg, options.aspect_deg, options.uneven_deg, options.roughness),
        direction_cam1=_vector(flight.T),
        unit=unit,
        height=height,
        baseline=baseline,
        points=options.points,
        noise_px=options.noise_px,
        wanted=None if options.sigma_deg is None else Wanted(options.sigma_deg, options.of),
        worst_sigma_deg=_degrees(sigma_of(cast.sigma_rad, "worst")),
        median_sigma_deg=_degrees(sigma_of(cast.sigma_rad, "median")),
        sigma_source=cast.source,
        parallax_px=cast.median_parallax_px,
        zoom=cast.zoom,
        second_answer=SecondAnswer(cast.second_answer >= LIKELY, cast.second_answer, _degrees(cast.first_error_rad)),
        windows=planned,
        diagnostics=tuple(_diagnostics(cast, planned, focus, options)),
        epipole1_px=focus,
    )


def _baseline_for(flight: Flight, sigma_rad: float, of: Of) -> float:
    """In heights; rather longer than the sigma needs than so short that estimate would ask for a longer one."""
    try:
        return needed_baseline(flight, sigma_rad, of, ample=True)
    except NoAnswer:
        return needed_baseline(flight, sigma_rad, of)


def sigma_text(sigma_deg: float | None) -> str:
    """Two figures of a sigma: "0.034°", "1.2°", "14°"; "-" for none."""
    if sigma_deg is None:
        return "-"
    if sigma_deg < 0.0995:
        return f"{sigma_deg:.2g}°"
    digits = 2 if sigma_deg < 0.995 else 1 if sigma_deg < 9.95 else 0
    return f"{sigma_deg:.{digits}f}°"


def _flight(camera: Camera, windows: Sequence[Window], options: PlanOptions) -> Flight:
    up = _up(options)
    downhill = horizontal(up, float(np.radians(options.aspect_deg)), _north(options))
    slope, uneven = float(np.radians(options.slope_deg)), float(np.radians(options.uneven_deg))
    return Flight(
        camera,
        windows,
        _direction(options, up),
        ground_normals(camera, windows, up, slope, downhill, uneven),
        up,
        float(np.radians(options.up_sigma_deg)),
        options.points,
        options.noise_px,
        options.roughness,
    )


def _up(options: PlanOptions) -> FloatArray:
    if isinstance(options.up, str) and options.up != "camera":
        raise InputError(
            f"up is {options.up!r}, but before the flight no plane is known; give camera or three numbers X,Y,Z"
        )
    vector = np.array(CAMERA_UP if isinstance(options.up, str) else options.up, float)
    return unit_vector(vector)


def _north(options: PlanOptions) -> FloatArray | None:
    return None if options.north is None else np.array(options.north, float)


def _direction(options: PlanOptions, up: FloatArray) -> FloatArray:
    if (options.direction is None) == (options.trajectory_deg is None):
        raise InputError("give either the direction of the motion or its angle from the vertical")
    if options.trajectory_deg is None:
        return np.array(options.direction, float)
    angle = np.radians(options.trajectory_deg)
    direction = np.sin(angle) * horizontal(up, np.pi / 2) - np.cos(angle) * up
    return np.where(np.abs(direction) < ROUNDING, 0.0, direction)


def _lengths(options: PlanOptions) -> tuple[Literal["m", "baseline", "height"], float, float]:
    """Unit, height and baseline; the latter is still to be found where a sigma is wanted."""
    if options.sigma_deg is not None:
        if options.baseline is not None:
            raise InputError("a baseline and a sigma are given; give one, and the other follows")
        return ("height", 1.0, 0.0) if options.height is None else ("m", options.height, 0.0)
    if options.height is None:
        raise InputError("no height is given; give it with the baseline, or in baselines, or give a sigma")
    return ("baseline", options.height, 1.0) if options.baseline is None else ("m", options.height, options.baseline)


def _focus(flight: Flight) -> tuple[float, float] | None:
    """Pixel of image 1 the camera moves towards or away from, None when it is not inside the image."""
    focus = focus_of_expansion(flight.T)
    if focus is None:
        return None
    u, v = (float(c) for c in pixels_from_rays(flight.camera, focus[None])[0])
    inside = -0.5 <= u < flight.camera.width - 0.5 and -0.5 <= v < flight.camera.height - 0.5  # False for NaN, too
    return (u, v) if inside else None


def _window(i: int, flight: Flight, cast: Forecast) -> PlannedWindow:
    share, sigma = float(cast.share[i]), _degrees(float(cast.sigma_rad[i]))
    parallax = None if np.isnan(cast.parallax_px[i]) else float(cast.parallax_px[i])
    status, reason = _status(share, sigma)
    unseen = None if sigma is None else _degrees(float(cast.unseen_rad[i]))
    return PlannedWindow(i + 1, flight.windows[i], sigma, parallax, share, status, reason, unseen)


def _status(share: float, sigma: float | None) -> tuple[Literal["ok", "poor", "refused"], str | None]:
    if sigma is None:
        lost = share < LEAST_SHARE
        return "refused", "image 2 does not show its ground" if lost else "its slope is left open"
    if sigma > VAGUE_DEG:
        return "poor", f"estimate tells no slope whose sigma is above {VAGUE_DEG:g}° (--max-sigma)"
    return (
        ("poor", f"image 2 shows only {beside(100 * share, 100 * HALF_SEEN)} % of it")
        if share < HALF_SEEN
        else ("ok", None)
    )


def _diagnostics(
    cast: Forecast, windows: Sequence[PlannedWindow], focus: tuple[float, float] | None, options: PlanOptions
) -> list[Diagnostic]:
    found = list(cast.diagnostics)
    found += [_focus_in(one) for one in windows if focus is not None and _holds(one.window, focus)]
    if cast.second_answer >= LIKELY:
        found.append(_second_answer(cast, options.sigma_deg))
    if options.sigma_deg is not None and _is_better(cast, options.sigma_deg, options.of):
        found.append(_for_parallax(cast, options.sigma_deg))
    if cast.source == "simulation":
        said = "two answers run into each other; sigmas are those of simulated pairs, not of a covariance"
        found.append(finding("single-plane", said, severity="info"))
    if cast.zoom > LARGEST_ZOOM:
        said = (
            f"one image shows the ground {cast.zoom:.1f} times as large as the other, matching bears {LARGEST_ZOOM:g}"
        )
        found.append(finding("no-overlap", said, cast.zoom))
    return found


def _holds(window: Window, point: tuple[float, float]) -> bool:
    x, y, w, h = window
    return x - 0.5 <= point[0] < x + w - 0.5 and y - 0.5 <= point[1] < y + h - 0.5


def _focus_in(one: PlannedWindow) -> Diagnostic:
    said = f"the camera moves along a line of sight through window {one.id}: it shows least parallax there"
    return finding("foe-in-window", said, float(one.id), "move sideways as well")


def _second_answer(cast: Forecast, wanted_deg: float | None) -> Diagnostic:
    off = sigma_text(_degrees(cast.first_error_rad))
    wanted = "" if wanted_deg is None else f", and this baseline gives {wanted_deg:g}° to no one else"
    return finding(
        "single-plane",
        f"two answers are likely: so it is in {round(cast.second_answer * TRIALS)} of {TRIALS} simulated pairs, as a "
        "second motion explains them as well; sigmas hold for who knows which is right, the first by itself is off by "
        f"{off} (RMS, median window){wanted}",
        cast.second_answer,
        "give estimate the motion (--direction-prior, --pose), fly level, or choose ground with more relief",
        severity="warning",
    )


def _is_better(cast: Forecast, wanted_deg: float, of: Of) -> bool:
    """Whether the sigma is clearly smaller than the one asked for: the parallax was what took the baseline."""
    return sigma_of(cast.sigma_rad, of) < (1.0 - TOLERATED) * float(np.radians(wanted_deg))


def _for_parallax(cast: Forecast, wanted_deg: float) -> Diagnostic:
    return finding(
        "low-parallax",
        f"a shorter baseline gives {wanted_deg:g}° as well, but less than the {LOW_PARALLAX_PX:g} px of parallax that "
        "slopes need; this is the shortest with both",
        cast.median_parallax_px,
        severity="info",
    )


def _degrees(sigma_rad: float) -> float | None:
    return float(np.degrees(sigma_rad)) if np.isfinite(sigma_rad) else None


def _vector(v: FloatArray) -> Vector:
    return float(v[0]), float(v[1]), float(v[2])
