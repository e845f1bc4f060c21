"""Predicted slope sigmas of a pair of images, by the solver's covariance at the truth and by simulated pairs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from slopecli.errors import NoAnswer, SlopemapError
from slopecli.findings.camera_checks import implausible_cameras
from slopecli.findings.parallax import check_parallax, parallax_px
from slopecli.geometry.epipolar import normal_angle
from slopecli.geometry.slope import measure_slopes
from slopecli.geometry.solver.observations import linearise, observe
from slopecli.geometry.solver.refinement import State, normal_equations
from slopecli.geometry.solver.solve import solve_planes
from slopecli.geometry.solver.uncertainty import covariance_of
from slopecli.look.noise import SYSTEMATIC_PX
from slopecli.options import MOST_SIGMA_DEG
from slopecli.plan.flight import Flight, Seen, refuse_sky, see, unseen_tilts
from slopecli.types import Diagnostic, FloatArray, Solution

TRIALS = 20  # simulated pairs that show whether there are two answers


@dataclass(frozen=True, eq=False)
class Forecast:
    """What a pair with a given baseline will tell; (m,) arrays over the windows, NaN where there is no answer.

    sigma_rad : 1-sigma of the slopes.  source : the solver's covariance, or simulated pairs, where two answers
        run into each other and a covariance says too much.
    share : of each window seen in image 2.  unseen_rad : 1-sigma that the rest adds in `estimate`, as it may tilt
        otherwise; not NaN anywhere, and not in sigma_rad.  parallax_px : median in each window.
    median_parallax_px : of all points.  zoom : scale of image 2 over image 1, or its inverse, in the window of most.
    second_answer : share of the simulated pairs that have two answers: sigmas are those of the right one.
    first_error_rad : RMS error of the slopes, in the median window, of whoever takes the first answer all the same.
    """

    baseline: float
    sigma_rad: FloatArray
    source: Literal["covariance", "simulation"]
    share: FloatArray
    unseen_rad: FloatArray
    parallax_px: FloatArray
    median_parallax_px: float
    zoom: float
    second_answer: float
    first_error_rad: float
    diagnostics: tuple[Diagnostic, ...]

    @property
    def two_answers_likely(self) -> bool:
        return self.second_answer >= 0.5


def forecast(flight: Flight, baseline: float) -> Forecast:
    """What the pair tells with a baseline, in heights.

    Raises
    ------
    NoAnswer : image 2 shows none of the windows, or there is too little parallax, as `estimate` would refuse it.
    """
    refuse_sky(flight)
    seen = see(flight, baseline)
    if not len(seen.windows):
        raise NoAnswer(
            "no-overlap",
            f"image 2 shows none of the {len(flight.windows)} windows on the ground",
            "shorten the baseline, or turn the camera to the ground with --up",
        )
    parallax = parallax_px(seen.x1, seen.x2, flight.camera.focal_px)
    camera = flight.camera
    diagnostics = [*implausible_cameras(camera, camera), *planned_parallax(parallax, flight.noise_px)]
    sigma, (second_answer, error, first_error) = slope_sigmas(flight, seen), _simulate(flight, seen)
    # where the two roots run into each other, the simulated errors are far smaller than the covariance says
    joined = float(np.median(error)) < 0.5 * float(np.median(sigma))
    sigma = error if joined else sigma
    sigma = np.where(sigma <= np.radians(MOST_SIGMA_DEG), sigma, np.nan)
    if np.isnan(sigma).all():
        raise _open(flight, seen)
    depth, windows = seen.prediction.depth_ratio[0], range(len(seen.windows))
    return Forecast(
        baseline=baseline,
        sigma_rad=_spread(flight, seen, sigma),
        source="simulation" if joined else "covariance",
        share=seen.share,
        unseen_rad=unseen_tilts(flight, baseline),
        parallax_px=_spread(flight, seen, np.array([np.median(parallax[seen.patch == k]) for k in windows])),
        median_parallax_px=float(np.median(parallax)),
        zoom=max(float(np.median(np.maximum(depth, 1.0 / depth)[seen.patch == k])) for k in windows),
        second_answer=second_answer,
        first_error_rad=float(np.median(first_error)),
        diagnostics=tuple(diagnostics),
    )


def planned_parallax(parallax: FloatArray, noise_px: float) -> list[Diagnostic]:
    """What `estimate` would say of parallax (n,) px; it refuses matches that are found, here none are yet.

    Raises
    ------
    NoAnswer : there is too little.
    """
    try:
        return check_parallax(parallax, noise_px)
    except NoAnswer as refused:
        raise NoAnswer(
            refused.code,
            f"the parallax is {refused.value:.2g} px at most, which among matches that err by {noise_px:g} px is no "
            "parallax",
            "lengthen the baseline (5 to 20 % of the height is usual), or count on less noise (--noise)",
            value=refused.value,
        ) from refused


def _open(flight: Flight, seen: Seen) -> NoAnswer:
    """Error for a pair whose slopes are all unknown: because of the up direction, or because of the images."""
    what = f"the slopes of all {len(flight.windows)} windows are left open"
    if slope_sigmas(replace(flight, up_sigma_rad=0.0), seen).min() <= np.radians(MOST_SIGMA_DEG):
        what += f", as what is up is known to {np.degrees(flight.up_sigma_rad):.3g} deg only"
        return NoAnswer("up-unknown", what, "give up with a smaller --up-sigma")
    return NoAnswer("low-parallax", what, "lengthen the baseline, give larger windows, or fly in another direction")


def slope_sigmas(flight: Flight, seen: Seen) -> FloatArray:
    """(k,) 1-sigma of the slopes of the windows seen, rad, from the covariance at the truth."""
    if not len(seen.windows):
        return np.array([np.inf])
    noise = flight.noise_px / flight.camera.focal_px * flight.more
    blank = observe(seen.x1, np.zeros_like(seen.x1), seen.patch, seen.weight)
    state = State(np.eye(3)[None], flight.T[None], seen.normals[None])
    system = normal_equations(state, linearise(blank, seen.prediction, _weights(flight, seen)))
    covariance = covariance_of(system, flight.T, 0, noise)
    solution = Solution(
        R=np.eye(3),
        T=flight.T,
        scaled_normals=seen.normals,
        **covariance._asdict(),
        noise=noise,
        relief=np.zeros(len(seen.windows)),
        rms=noise,
        chi2=0.0,
        inlier=np.ones(len(seen.x1), bool),
        converged=True,
        iterations=0,
        noise_gain=1.0,
    )
    return measure_slopes(solution, flight.up, flight.up_sigma_rad).sigma_rad


def _weights(flight: Flight, seen: Seen) -> FloatArray | None:
    """(1, 3, n) packed 2x2 weights: across its epipolar line a point errs by noise, along it by relief as well."""
    if flight.roughness == 0.0:
        return None
    noise = flight.noise_px / flight.camera.focal_px
    slide = seen.prediction.slide[0]
    spread = (seen.prediction.inverse_depth[0] * flight.roughness / noise) ** 2
    factor = spread / (1.0 + spread * (slide**2).sum(axis=0))  # the inverse of I + spread d d^T (Sherman, Morrison)
    first, mixed, second = 1.0 - factor * slide[0] ** 2, -factor * slide[0] * slide[1], 1.0 - factor * slide[1] ** 2
    return seen.weight * np.stack([first, mixed, second])[None]


def _simulate(flight: Flight, seen: Seen) -> tuple[float, FloatArray, FloatArray]:
    """Solve pairs with noise, always the same ones; if none can be solved, the solver's error is raised.

    Returns the share of them with two roots, and RMS errors of the slopes (k,), rad, of the right and the first root.
    """
    unresolved, squares, firsts, trouble = 0, [], [], None
    true = normal_angle(-seen.normals, flight.up)
    for trial in range(TRIALS):
        try:
            solution = _solved(flight, seen, np.random.default_rng(trial))
        except SlopemapError as error:
            trouble = error
            continue
        second = None if _ruled_out(flight, seen, solution) else solution.ambiguity.alternative
        unresolved += second is not None
        roots = [solution] if second is None else [solution, second]
        errors = [(normal_angle(-root.scaled_normals, flight.up) - true) ** 2 for root in roots]
        squares.append(min(errors, key=lambda error: float(error.sum())))
        firsts.append(errors[0])
    if not squares and trouble is not None:
        raise trouble
    right, first = (np.sqrt(np.mean(errors, axis=0) + flight.up_sigma_rad**2) for errors in (squares, firsts))
    return unresolved / len(squares), right, first


def _ruled_out(flight: Flight, seen: Seen, solution: Solution) -> bool:
    """Whether estimate would hold the second root, if there is one, to be wrong."""
    found = solution.ambiguity
    if found.status == "unresolved" or found.delta_chi2 is None:
        return found.status != "unresolved"
    # one point of a plan stands for about four matches, which share their errors
    matches = 4 * flight.points * float(seen.share[seen.windows].sum())
    return flight.noise_px * float(np.sqrt(found.delta_chi2 / matches)) > SYSTEMATIC_PX


def _solved(flight: Flight, seen: Seen, rng: np.random.Generator) -> Solution:
    scale = flight.more / np.sqrt(seen.weight)
    relief = flight.roughness * scale * rng.standard_normal(len(seen.x1))
    moved = seen.x2 + (seen.prediction.slide[0] * seen.prediction.inverse_depth[0] * relief).T
    noise = flight.noise_px / flight.camera.focal_px * scale
    found = moved + noise[:, None] * rng.standard_normal(moved.shape)
    rough = flight.roughness > 0.0
    return solve_planes(seen.x1, found, seen.patch, weights=seen.weight, relief=rough, robust=False)


def _spread(flight: Flight, seen: Seen, values: FloatArray) -> FloatArray:
    """Values of the windows seen (k,) as values of all windows (m,), NaN for the others."""
    every = np.full(len(flight.windows), np.nan)
    every[seen.windows] = values
    return every
