"""From `PlanOptions` to a `Plan`: the predicted slope uncertainty of a pair of images still to be taken."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from slopecli.errors import InputError, NoAnswer
from slopecli.geometry.camera import pixels_from_rays
from slopecli.geometry.epipolar import focus_of_expansion, unit_vector
from slopecli.geometry.slope import CAMERA_UP
from slopecli.plan.baseline import Of, needed_baseline, sigma_of
from slopecli.plan.flight import Flight, Window, ground_normals, horizontal
from slopecli.plan.notes import diagnostics_of, window_status
from slopecli.plan.plan_options import PlanOptions, Vector
from slopecli.plan.planned import Ground, Plan, PlannedWindow, SecondAnswer, Wanted
from slopecli.plan.prediction import Forecast, forecast
from slopecli.types import Camera, FloatArray, Up


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
        second_answer=SecondAnswer(cast.two_answers_likely, cast.second_answer, _degrees(cast.first_error_rad)),
        windows=planned,
        diagnostics=tuple(diagnostics_of(cast, planned, focus, options)),
        epipole1_px=focus,
    )


def _baseline_for(flight: Flight, sigma_rad: float, of: Of) -> float:
    """In heights; rather longer than the sigma needs than so short that estimate would ask for a longer one."""
    try:
        return needed_baseline(flight, sigma_rad, of, ample=True)
    except NoAnswer:
        return needed_baseline(flight, sigma_rad, of)


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
    focus = focus_of_expansion(flight.T)
    if focus is None:
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


def _degrees(sigma_rad: float) -> float | None:
    return float(np.degrees(sigma_rad)) if np.isfinite(sigma_rad) else None


def _vector(v: FloatArray) -> Vector:
    return float(v[0]), float(v[1]), float(v[2])
