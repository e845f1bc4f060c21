"""The simulation study of the paper, section 4.1: every solver on the same scenes, the Cramer-Rao bound, and times."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass, replace
from itertools import count, product, takewhile
from typing import Any, NamedTuple

import numpy as np

from slopecli.errors import SlopemapError
from slopecli.geometry.epipolar import direction_angle, normal_angle, rotation_angle
from slopecli.geometry.homography import apply_homography, fit_homography, homography_of_plane
from slopecli.geometry.solver.solve import solve_planes
from slopecli.geometry.solver.uncertainty import cramer_rao_bound
from slopecli.study.parameters import StudyOptions
from slopecli.study.scenes import Scene, field_of_view_camera, make_scene
from slopecli.types import Camera, FloatArray

SOLVERS = ("mle", "ha", "lh")
QUANTITIES = ("rotation_error", "direction_error", "normal_errors")
OnProgress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Trial:
    """Errors of one solver on one scene, rad; NaN and the reason when it gave no answer."""

    solver: str
    trajectory_deg: float
    noise_px: float
    terrain: int
    rotation_error: float
    direction_error: float
    normal_errors: FloatArray
    iterations: int
    converged: bool
    reason: str | None = None


@dataclass(frozen=True, eq=False)
class Least:
    """What the Cramer-Rao bound leaves of the error measures in one scene, rad; slopes (m,) are the true ones.

    rms : of rotation, direction and normals (m,), the least there can be.  mean : of errors Gaussian and at the bound.
    """

    trajectory_deg: float
    noise_px: float
    terrain: int
    rms: tuple[float, float, FloatArray]
    mean: tuple[float, float, FloatArray]
    slopes: FloatArray


Measures = tuple[float, float, FloatArray]  # of rotation, direction and normals (m,)
Case = tuple[Least, list[Trial]]  # one scene: what can be reached, and what every solver reaches
Work = tuple[StudyOptions, Camera, int, int]  # number of the trajectory, and of the terrain


@dataclass(frozen=True, eq=False)
class Study:
    """All trials and bounds, by trajectory, noise, terrain and solver in the order of the options."""

    options: StudyOptions
    camera: Camera
    trials: list[Trial]
    bounds: list[Least]

    def errors(self, solver: str, quantity: str) -> FloatArray:
        """(trajectories, noises, terrains) rad, "rotation_error" or "direction_error"; (..., m) "normal_errors"."""
        return self._by_case([getattr(trial, quantity) for trial in self.trials if trial.solver == solver])

    def bound(self, quantity: str, kind: str = "rms") -> FloatArray:
        """The same of the bound, "rms" or "mean"; `quantity` as for `errors`."""
        return self._by_case([getattr(least, kind)[QUANTITIES.index(quantity)] for least in self.bounds])

    def _by_case(self, values: Sequence[float | FloatArray]) -> FloatArray:
        o, array = self.options, np.array(values)
        return array.reshape(len(o.trajectories_deg), len(o.noises_px), o.terrains, *array.shape[1:])


def run_study(
    options: StudyOptions,
    camera: Camera | None = None,
    executors: Sequence[Executor] = (),
    on_progress: OnProgress | None = None,
) -> Study:
    """Run every solver on every scene of a study. The answer does not depend on where or in which order it is done.

    The terrain of one number is the same for every trajectory and noise; the noise is drawn anew.

    Parameters
    ----------
    camera : of both images; None makes that of the options.  executors : each is given one piece of work at a time,
        which can be pickled; none: it is done here.  on_progress : called with trials done and trials in all.

    Raises
    ------
    InputError : a scene of the study cannot be seen by both cameras.
    """
    camera = camera or camera_of(options)
    works = [(options, camera, i, k) for i in range(len(options.trajectories_deg)) for k in range(options.terrains)]
    answers: dict[int, list[Case]] = {}
    for number, answer in _answers(works, executors):
        answers[number] = answer
        if on_progress is not None:
            on_progress(len(answers) * len(options.noises_px), len(works) * len(options.noises_px))
    order = product(range(len(options.trajectories_deg)), range(len(options.noises_px)), range(options.terrains))
    cases = [answers[i * options.terrains + k][noise] for i, noise, k in order]
    return Study(options, camera, [t for _, trials in cases for t in trials], [least for least, _ in cases])


def camera_of(options: StudyOptions) -> Camera:
    """The camera that the options describe."""
    return field_of_view_camera(*options.image_size, options.fov_deg)


def paper_study(
    solvers: Sequence[str] = SOLVERS,
    trajectories_deg: Sequence[float] = StudyOptions.trajectories_deg,
    noises_px: Sequence[float] = StudyOptions.noises_px,
    terrains: int = StudyOptions.terrains,
    seed: int = 0,
) -> list[Trial]:
    """Trials of section 4.1, or of a part of it, in this process; 1320 scenes by default."""
    options = StudyOptions(tuple(trajectories_deg), tuple(noises_px), terrains, solvers=tuple(solvers), seed=seed)
    return run_study(options).trials


def _answers(works: Sequence[Work], executors: Sequence[Executor]) -> Iterator[tuple[int, list[Case]]]:
    """Number and answer of each piece of work as it is done."""
    if not executors:
        yield from ((number, run_terrain(*work)) for number, work in enumerate(works))
        return
    left, idle = iter(enumerate(works)), list(executors)
    under_way: dict[Future[list[Case]], tuple[int, Executor]] = {}
    while True:
        for executor, (number, work) in zip(list(idle), left, strict=False):
            under_way[executor.submit(run_terrain, *work)] = number, executor
            idle.remove(executor)
        if not under_way:
            return
        for future in wait(under_way, return_when=FIRST_COMPLETED).done:
            number, executor = under_way.pop(future)
            idle.append(executor)
            yield number, future.result()


def run_terrain(options: StudyOptions, camera: Camera, trajectory: int, terrain: int) -> list[Case]:
    """One terrain from one trajectory (by number), under every noise in turn."""
    angle, cases = options.trajectories_deg[trajectory], []
    scenes = [study_scene(options, camera, trajectory, noise, terrain) for noise in range(len(options.noises_px))]
    rms, mean = least_errors(scenes[0], 1.0 / camera.focal_px)  # the same ground under all
    for noise, scene in zip(options.noises_px, scenes, strict=True):
        bound = Least(angle, noise, terrain, _scaled(rms, noise), _scaled(mean, noise), scene.slopes)
        cases.append((bound, [run_trial(scene, solver, angle, noise, terrain) for solver in options.solvers]))
    return cases


def study_scene(options: StudyOptions, camera: Camera, trajectory: int, noise: int, terrain: int) -> Scene:
    """The scene of one trial; trajectory and noise by their numbers."""
    return make_scene(
        np.random.default_rng([options.seed, terrain]),
        trajectory_deg=options.trajectories_deg[trajectory],
        heading_deg=options.heading_deg,
        rotation_deg=options.rotation_deg,
        noise_px=options.noises_px[noise],
        noise1_px=options.noise1_px,
        outliers=options.outliers,
        noise_rng=np.random.default_rng([options.seed, terrain, trajectory, noise]),
        grid=options.grid,
        relief=options.relief,
        **_scene_options(options, camera),
    )


def _scene_options(options: StudyOptions, camera: Camera) -> dict[str, Any]:
    """What all scenes of a study share, as options of `make_scene`."""
    names = ("baseline_over_height", "points", "max_slope_deg", "height_spread")
    return {"camera": camera, **{name: getattr(options, name) for name in names}}


def run_trial(scene: Scene, solver: str, trajectory_deg: float, noise_px: float, terrain: int) -> Trial:
    """Solve one scene and compare with its truth (the paper's three error measures)."""
    try:
        solution = solve_planes(scene.x1, scene.x2, scene.patch, solver)  # type: ignore[arg-type]
    except SlopemapError as error:
        nothing = np.full(len(scene.normals), np.nan)
        return Trial(solver, trajectory_deg, noise_px, terrain, np.nan, np.nan, nothing, 0, False, str(error))
    rotation, direction = rotation_angle(solution.R, scene.R), direction_angle(solution.T, scene.T)
    errors = float(rotation), float(direction), normal_angle(solution.scaled_normals, scene.normals)
    return Trial(solver, trajectory_deg, noise_px, terrain, *errors, solution.iterations, solution.converged)


def _scaled(measures: Measures, factor: float) -> Measures:
    return factor * measures[0], factor * measures[1], factor * measures[2]


def least_errors(scene: Scene, noise: float) -> tuple[Measures, Measures]:
    """Least RMS of the three error measures, and their mean at the bound, rad: rotation, direction, normals (m,).

    noise : 1-sigma of a normalised coordinate in image 2; image 1 is exact, the patches are plane.
    """
    on_plane = scene.patch >= 0
    least = cramer_rao_bound(scene.R, scene.T, scene.normals, scene.x1_clean[on_plane], scene.patch[on_plane], noise)
    length = np.linalg.norm(scene.normals, axis=1)
    unit = scene.normals / length[:, None]
    across = (np.eye(3) - unit[:, :, None] * unit[:, None]) / length[:, None, None]
    normals = across @ least.normal_covariance @ across
    direction = least.tangent @ least.motion_covariance[3:, 3:] @ least.tangent.T
    covariances = np.concatenate([[least.motion_covariance[:3, :3], direction], normals])
    rms, mean = np.sqrt(np.trace(covariances, axis1=1, axis2=2)), mean_length(covariances)
    return (float(rms[0]), float(rms[1]), rms[2:]), (float(mean[0]), float(mean[1]), mean[2:])


def mean_length(covariances: FloatArray) -> FloatArray:
    """(k,) mean length of Gaussian vectors of covariances (k, 3, 3): mean radius times the mean over directions."""
    number = np.arange(500)
    height = (number + 0.5) / len(number) * 2.0 - 1.0  # a spiral that covers the sphere evenly
    turn = number * np.pi * (3.0 - np.sqrt(5.0))
    across = np.sqrt(1.0 - height**2)
    u = np.column_stack([across * np.cos(turn), across * np.sin(turn), height])
    square = np.einsum("di,kij,dj->kd", u, covariances, u)
    return np.asarray(np.sqrt(8.0 / np.pi) * np.sqrt(np.maximum(square, 0.0)).mean(axis=1))


# ---- Figure 2: what alignment does to homographies ----


class Spread(NamedTuple):
    """Where the windows' homographies send the image's middle: (m, 2) px, about their mean, before and after alignment.

    off_line_before, off_line_after : RMS distance from the best line through them, px; the epipolar line runs along x.
    """

    before: FloatArray
    after: FloatArray
    off_line_before: float
    off_line_after: float


def alignment_spread(options: StudyOptions, camera: Camera, noise_px: float = 0.3) -> Spread:
    """The paper's Figure 2: level flight along x without rotation, so that epipolar lines are parallel to x."""
    shared = _scene_options(replace(options, points=max(options.points, 4)), camera)
    rng = np.random.default_rng([options.seed, options.terrains])
    scene = make_scene(rng, trajectory_deg=90.0, rotation_deg=0.0, noise_px=noise_px, grid=(3, 3), **shared)
    own = [fit_homography(scene.x1[scene.patch == i], scene.x2[scene.patch == i]) for i in range(len(scene.normals))]
    solution = solve_planes(scene.x1, scene.x2, scene.patch, "ha")
    aligned = homography_of_plane(solution.R, solution.T, solution.scaled_normals)
    before, after = (_images_of_middle(homographies, camera) for homographies in (own, aligned))
    return Spread(before, after, _off_line(before), _off_line(after))


def _images_of_middle(homographies: Sequence[FloatArray] | FloatArray, camera: Camera) -> FloatArray:
    images = np.array([apply_homography(H, np.zeros((1, 2)))[0] for H in homographies]) * [camera.fx, camera.fy]
    return np.asarray(images - images.mean(axis=0))


def _off_line(points: FloatArray) -> float:
    return float(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(points)))


# ---- Figure 6: time against the number of windows ----


class Timing(NamedTuple):
    """Processor time of one solver on one scene, the least of a few, seconds."""

    solver: str
    windows: int
    seconds: float
    iterations: int


def measure_times(
    options: StudyOptions, camera: Camera, on_progress: Callable[[int, int], None] | None = None
) -> list[Timing]:
    """Time of every solver on grids of 4, 16, ... windows, the same ones on every machine, however busy it is."""
    sizes = list(takewhile(lambda windows: windows <= options.most_windows, (4**k for k in count(1))))
    solvers = [s for s in options.solvers if s == "mle" or options.points >= 4]  # of a homography
    timings: list[Timing] = []
    for number, windows in enumerate(sizes):
        side = round(np.sqrt(windows))
        rng = np.random.default_rng([options.seed, windows])
        scene = make_scene(rng, grid=(side, side), **_scene_options(options, camera))
        timings += [_time(scene, s, windows) for s in solvers]
        if on_progress is not None:
            on_progress(number + 1, len(sizes))
    return timings


def _time(scene: Scene, solver: str, windows: int, enough_s: float = 2.5) -> Timing:
    """The least of three times, or of fewer where they took long enough together not to depend on the moment."""
    best, iterations, spent = np.inf, 0, 0.0
    for _ in range(3):
        start = time.process_time()
        iterations = solve_planes(scene.x1, scene.x2, scene.patch, solver).iterations  # type: ignore[arg-type]
        taken = time.process_time() - start
        best, spent = min(best, taken), spent + taken
        if spent > enough_s:
            break
    return Timing(solver, windows, best, iterations)
