"""Time of the solvers against the number of windows (the paper's Figure 6)."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from slopecli.geometry.solver.solve import solve_planes
from slopecli.study.parameters import FEWEST_ALONE, StudyOptions
from slopecli.study.scenes import Scene, make_scene
from slopecli.types import Camera

PATIENCE_S = 5.0  # a solver that would take longer is not timed with more windows


class Timing(NamedTuple):
    """Processor time of one solver on one scene, the least of a few, seconds."""

    solver: str
    windows: int
    seconds: float
    iterations: int


def measure_times(
    options: StudyOptions, camera: Camera, on_progress: Callable[[int, int], None] | None = None
) -> list[Timing]:
    """Time of every solver on grids of 4, 16, ... windows; one that would take too long is left out from there on."""
    sizes = list[int]()
    while 4 ** (len(sizes) + 1) <= options.most_windows:
        sizes.append(4 ** (len(sizes) + 1))
    solvers = [s for s in options.solvers if s == "mle" or options.points >= FEWEST_ALONE]
    timings: list[Timing] = []
    for number, windows in enumerate(sizes):
        side = round(np.sqrt(windows))
        scene = make_scene(
            np.random.default_rng([options.seed, windows]),
            baseline_over_height=options.baseline_over_height,
            camera=camera,
            grid=(side, side),
            points=options.points,
            max_slope_deg=options.max_slope_deg,
            height_spread=options.height_spread,
        )
        timings += [_time(scene, s, windows) for s in solvers if _expected_s(timings, s) < PATIENCE_S]
        if on_progress is not None:
            on_progress(number + 1, len(sizes))
    return timings


def _expected_s(timings: Sequence[Timing], solver: str) -> float:
    """Seconds with the next number of windows, if they grow as they did last time."""
    own = [timing for timing in timings if timing.solver == solver]
    if len(own) < 2:
        return 0.0
    if own[-1].windows != timings[-1].windows:
        return np.inf  # left out already
    return own[-1].seconds ** 2 / max(own[-2].seconds, 1e-6)


def _time(scene: Scene, solver: str, windows: int) -> Timing:
    best, iterations, spent = np.inf, 0, 0.0
    for _ in range(3):
        start = time.process_time()
        iterations = solve_planes(scene.x1, scene.x2, scene.patch, solver).iterations  # type: ignore[arg-type]
        taken = time.process_time() - start
        best, spent = min(best, taken), spent + taken
        if spent > PATIENCE_S / 2:
            break
    return Timing(solver, windows, best, iterations)
