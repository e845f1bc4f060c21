"""A plan: from `PlanOptions` to the predicted slope uncertainty of a pair of images still to be taken."""

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
from slopecli.patches.patch import LEAST_MATCHED
from slopecli.plan.baseline import needed_baseline, sigma_of
from slopecli.plan.flight import LEAST_SHARE, Flight, Window, ground_normals, horizontal
from slopecli.plan.footprint_sigma import footprint_of, footprint_sigmas
from slopecli.plan.plan_options import Of, PlanOptions, Vector
from slopecli.plan.prediction import TRIALS, Forecast, forecast
from slopecli.types import Camera, Diagnostic, FloatArray, Up

LARGEST_ZOOM = 2.0  # scale between the images beyond which features are matched badly
VAGUE_DEG = Options().max_sigma_deg


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


@dataclass(frozen=True)
class PlannedMap:
    """1-sigma of the slope of a disc of `slopemap map` in the middle of every window, by the noise of matching.

    footprint_px : its diameter.  worst_sigma_deg, median_sigma_deg : of the windows whose middle image 2 shows and
        whose slope is not left open; None without any.
    """

    footprint_px: float
    worst_sigma_deg: float | None
    median_sigma_deg: float | None


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
    map: PlannedMap
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


def window_status(share: float, sigma: float | None) -> tuple[Literal["ok", "poor", "refused"], str | None]:
    """Return status and reason of a window; share: of it in image 2, sigma: of its slope, deg."""
    if sigma is None:
        lost = share < LEAST_SHARE
        return "refused", "image 2 does not show its ground" if lost else "its slope is left open"
    if sigma > VAGUE_DEG:
        return "poor", f"estimate tells no slope whose sigma is above {VAGUE_DEG:g}° (--max-sigma)"
    if share < LEAST_MATCHED:
        return "poor", f"image 2 shows only {beside(100 * share, 100 * LEAST_MATCHED)} % of it"
    return "ok", None


def diagnostics_of(
    cast: Forecast, windows: Sequence[PlannedWindow], focus: tuple[float, float] | None, options: PlanOptions
) -> list[Diagnostic]:
    """Return the diagnostics of a plan; focus: pixel of image 1 the camera moves towards, if it is in the image."""
    found = list(cast.diagnostics)
    for one in windows:
        if focus is not None and _holds(one.window, focus):
            said = f"the camera moves along a line of sight through window {one.id}: it shows least parallax there"
            found.append(finding("foe-in-window", said, float(one.id), "move sideways as well"))
    if cast.two_answers_likely:
        found.append(_second_answer(cast, options.sigma_deg))
    # a sigma clearly smaller than the one asked for: the parallax was what took the baseline
    if options.sigma_deg is not None and sigma_of(cast.sigma_rad, options.of) < 0.99 * np.radians(options.sigma_deg):
        said = (
            f"a shorter baseline gives {options.sigma_deg:g}° as well, but less than the {LOW_PARALLAX_PX:g} px of "
            "parallax that slopes need; this is the shortest with both"
        )
        found.append(finding("low-parallax", said, cast.median_parallax_px, severity="info"))
    if cast.source == "simulation":
        said = "two answers run into each other; sigmas are those of simulated pairs, not of a covariance"
        found.append(finding("single-plane", said, severity="info"))
    if cast.zoom > LARGEST_ZOOM:
        said = f"one image shows the ground {cast.zoom:.1f} times as large as the other, matching bears"
        found.append(finding("no-overlap", f"{said} {LARGEST_ZOOM:g}", cast.zoom))
    return found


def _holds(window: Window, point: tuple[float, float]) -> bool:
    x, y, w, h = window
    return x - 0.5 <= point[0] < x + w - 0.5 and y - 0.5 <= point[1] < y + h - 0.5


def _second_answer(cast: Forecast, wanted_deg: float | None) -> Diagnostic:
    off = sigma_text(float(np.degrees(cast.first_error_rad)))
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
        sigma_rad = float(np.radians(options.sigma_deg))
        try:  # rather longer than the sigma needs than so short that estimate would ask for a longer one
            baseline = height * needed_baseline(flight, sigma_rad, options.of, ample=True)
        except NoAnswer:
            baseline = height * needed_baseline(flight, sigma_rad, options.of)
    cast = forecast(flight, baseline / height)
    focus = _focus(flight)
    footprint_px = footprint_of(flight, options.footprint_px)
    discs = footprint_sigmas(flight, baseline / height, footprint_px)
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
        second_answer=SecondAnswer(cast.two_answers_likely, cast.second_answer, _degrees(cast.first_error_rad)),
        map=_planned_map(footprint_px, discs),
        windows=planned,
        diagnostics=tuple(diagnostics_of(cast, planned, focus, options)),
        epipole1_px=focus,
    )


def _flight(camera: Camera, windows: Sequence[Window], options: PlanOptions) -> Flight:
    up, north = _up(options), None if options.north is None else np.array(options.north, float)
    angles_deg = options.slope_deg, options.aspect_deg, options.uneven_deg, options.up_sigma_deg
    slope, aspect, uneven, up_sigma = (float(np.radians(angle)) for angle in angles_deg)
    normals = ground_normals(camera, windows, up, slope, horizontal(up, aspect, north), uneven)
    matches = options.points, options.noise_px, options.roughness
    return Flight(camera, windows, _direction(options, up), normals, up, up_sigma, *matches)


def _up(options: PlanOptions) -> FloatArray:
    if isinstance(options.up, str) and options.up != "camera":
        said = f"up is {options.up!r}, but before the flight no plane is known"
        raise InputError(f"{said}; give camera or three numbers X,Y,Z")
    return unit_vector(np.array(CAMERA_UP if isinstance(options.up, str) else options.up, float))


def _direction(options: PlanOptions, up: FloatArray) -> FloatArray:
    if (options.direction is None) == (options.trajectory_deg is None):
        raise InputError("give either the direction of the motion or its angle from the vertical")
    if options.trajectory_deg is None:
        return np.array(options.direction, float)
    angle = np.radians(options.trajectory_deg)
    direction = np.sin(angle) * horizontal(up, np.pi / 2) - np.cos(angle) * up
    return np.where(np.abs(direction) < 1e-12, 0.0, direction)  # sines and cosines that are zero


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
    if (focus := focus_of_expansion(flight.T)) is None:
        return None
    u, v = (float(c) for c in pixels_from_rays(flight.camera, focus[None])[0])
    inside = -0.5 <= u < flight.camera.width - 0.5 and -0.5 <= v < flight.camera.height - 0.5  # False for NaN, too
    return (u, v) if inside else None


def _window(i: int, flight: Flight, cast: Forecast) -> PlannedWindow:
    share, sigma = float(cast.share[i]), _degrees(float(cast.sigma_rad[i]))
    parallax = None if np.isnan(cast.parallax_px[i]) else float(cast.parallax_px[i])
    status, reason = window_status(share, sigma)
    unseen = None if sigma is None else _degrees(float(cast.unseen_rad[i]))
    return PlannedWindow(i + 1, flight.windows[i], sigma, parallax, share, status, reason, unseen)


def _planned_map(footprint_px: float, sigma_rad: FloatArray) -> PlannedMap:
    known = sigma_rad[~np.isnan(sigma_rad)]
    if not len(known):
        return PlannedMap(footprint_px, None, None)
    return PlannedMap(footprint_px, _degrees(float(known.max())), _degrees(float(np.median(known))))


def _degrees(sigma_rad: float) -> float | None:
    return float(np.degrees(sigma_rad)) if np.isfinite(sigma_rad) else None


def _vector(v: FloatArray) -> Vector:
    return float(v[0]), float(v[1]), float(v[2])
