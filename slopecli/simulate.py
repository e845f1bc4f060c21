"""Scenes with known motion and planes: the paper's simulation (section 4.1), and whatever else a test may need.

What the paper leaves open, and what is chosen here: the distribution of terrain slopes (uniform in 0..40 deg, any
downhill azimuth), the height of the patches (their centres within 5 % of the nominal ground), the rotation between the
images (5 deg about a random axis), the direction of horizontal flight (image x) and where in its window a point lies
(uniform in the image). The nominal camera looks straight down, so `up` is (0, 0, -1).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from slopecli.errors import InputError, SlopemapError
from slopecli.geometry.epipolar import homogeneous, rotation_from_vector
from slopecli.geometry.metrics import direction_angle, normal_angle, rotation_angle
from slopecli.geometry.solve import solve_planes
from slopecli.types import BoolArray, Camera, FloatArray, IntArray

UP = np.array([0.0, 0.0, -1.0])
PAPER_TRAJECTORIES_DEG = (0.0, 45.0, 90.0)
PAPER_NOISES_PX = tuple(round(0.1 * i, 1) for i in range(11))
PAPER_TERRAINS = 40


@dataclass(frozen=True, eq=False)
class Scene:
    """Correspondences and the truth they come from; frames and units as in `types.Solution`.

    x1, x2 (n, 2) as found, x1_clean and x2_clean without noise or outliers; patch (n,) labels, -1 = on no plane;
    normals (m, 3) scaled, 1/baseline; relief: RMS height off the planes over their distance; outlier (n,) mismatches.
    noise: 1-sigma of a coordinate in image 2, normalised; noise1: the same in image 1.
    """

    camera: Camera
    R: FloatArray
    T: FloatArray
    normals: FloatArray
    x1: FloatArray
    x2: FloatArray
    x1_clean: FloatArray
    x2_clean: FloatArray
    patch: IntArray
    noise: float
    noise1: float
    relief: float
    outlier: BoolArray

    @property
    def slopes(self) -> FloatArray:
        """(m,) true angles between the surface normals and up, rad."""
        return normal_angle(-self.normals, UP)

    @property
    def uv1(self) -> FloatArray:
        """(n, 2) pixels of image 1."""
        return to_pixels(self.camera, self.x1)

    @property
    def uv2(self) -> FloatArray:
        """(n, 2) pixels of image 2."""
        return to_pixels(self.camera, self.x2)


def to_pixels(camera: Camera, x: FloatArray) -> FloatArray:
    """Normalised coordinates (n, 2) to pixels of a camera without distortion."""
    return np.asarray(x * [camera.fx, camera.fy] + [camera.cx, camera.cy])


def field_of_view_camera(width: int = 1024, height: int = 1024, fov_deg: float = 60.0) -> Camera:
    """Pinhole camera with the given horizontal field of view; by default the paper's."""
    focal = 0.5 * width / float(np.tan(np.radians(fov_deg) / 2.0))
    return Camera(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0, source="simulated")


def paper_scene(
    rng: np.random.Generator,
    trajectory_deg: float,
    noise_px: float,
    noise_rng: np.random.Generator | None = None,
) -> Scene:
    """One trial of section 4.1: 3x3 patches of 30 points, baseline one fifth of the height, noise in image 2 only.

    trajectory_deg : angle of the flight from the vertical; 0 descends, 45 glides, 90 flies level.
    """
    return make_scene(rng, trajectory_deg=trajectory_deg, noise_px=noise_px, noise_rng=noise_rng)


def make_scene(
    rng: np.random.Generator,
    *,
    camera: Camera | None = None,
    trajectory_deg: float = 45.0,
    baseline_over_height: float = 0.2,
    rotation_deg: float = 5.0,
    grid: tuple[int, int] = (3, 3),
    points: int = 30,
    slopes_deg: Sequence[float] | None = None,
    max_slope_deg: float = 40.0,
    height_spread: float = 0.05,
    relief: float = 0.0,
    free_points: int = 0,
    noise_px: float = 0.3,
    noise1_px: float = 0.0,
    outliers: float = 0.0,
    outlier_px: float = 40.0,
    noise_rng: np.random.Generator | None = None,
) -> Scene:
    """A downward-looking scene: one plane in each cell of a grid over image 1, seen again after a known motion.

    Parameters
    ----------
    rng : source of every random choice; the same generator state gives the same scene.
    grid : (columns, rows) of patches.  points : of each patch.
    slopes_deg : slope of each patch, row by row; None draws them uniformly from 0..max_slope_deg.
    height_spread : patch centres lie this part of the height above or below the nominal ground, uniformly.
    relief : RMS height of the points off their plane over the distance of the plane.
    free_points : points on no plane, depths within 20 % of the nominal.
    outliers : share of patch and free points moved by up to outlier_px in each image-2 coordinate.
    noise_rng : source of noise and outliers, to see one terrain under many noises; None goes on with `rng`.

    Raises
    ------
    InputError : a plane is too steep to be seen everywhere in its cell.
    """
    camera = camera or field_of_view_camera()
    m = grid[0] * grid[1]
    T_unit = np.array([np.sin(np.radians(trajectory_deg)), 0.0, np.cos(np.radians(trajectory_deg))])
    R = _random_rotation(rng, rotation_deg)
    cells = _cells(camera, grid)
    uv = np.concatenate([rng.uniform(low, high, (points, 2)) for low, high in cells])
    patch = np.repeat(np.arange(m), points)
    slopes = rng.uniform(0.0, max_slope_deg, m) if slopes_deg is None else np.asarray(slopes_deg, dtype=float)
    if len(slopes) != m:
        raise InputError(f"{len(slopes)} slopes given for {m} patches; give one for each, row by row")
    centres = _normalised(camera, np.array([(low + high) / 2.0 for low, high in cells]))
    heights = 1.0 + rng.uniform(-height_spread, height_spread, m)
    normals = _terrain(rng, centres, np.radians(slopes), heights) * baseline_over_height
    x1 = _normalised(camera, uv)
    # eq. (1): N.P = 1
    inverse_depth = np.sum(normals[patch] * homogeneous(x1), axis=1) / (1.0 + relief * rng.standard_normal(len(x1)))
    if free_points:
        uv_free = rng.uniform([0.0, 0.0], [camera.width - 1.0, camera.height - 1.0], (free_points, 2))
        x1 = np.concatenate([x1, _normalised(camera, uv_free)])
        inverse_depth = np.append(inverse_depth, baseline_over_height / rng.uniform(0.8, 1.2, free_points))
        patch = np.append(patch, np.full(free_points, -1))
    if (inverse_depth <= 0.0).any():
        raise InputError(
            "a plane is too steep to be seen everywhere in its cell; lower the slopes or the field of view"
        )
    x2 = project(R, T_unit, x1, inverse_depth)
    noise, noise1 = noise_px / camera.focal_px, noise1_px / camera.focal_px
    rng = noise_rng or rng
    outlier = rng.random(len(x1)) < outliers
    jumps = outlier[:, None] * rng.uniform(-outlier_px, outlier_px, x2.shape) / camera.focal_px
    found1 = x1 + noise1 * rng.standard_normal(x1.shape)
    found2 = x2 + noise * rng.standard_normal(x2.shape) + jumps
    return Scene(camera, R, T_unit, normals, found1, found2, x1, x2, patch, noise, noise1, relief, outlier)


def project(R: FloatArray, T: FloatArray, x1: FloatArray, inverse_depth: FloatArray) -> FloatArray:
    """Where image 2 sees the points x1 (n, 2) of image 1: P2 = R (P1 - T), inverse_depth (n,) in 1/baseline."""
    y = (homogeneous(x1) - inverse_depth[:, None] * T) @ R.T  # eq. (2), divided by the depth
    return np.asarray(y[:, :2] / y[:, 2:])


def _normalised(camera: Camera, uv: FloatArray) -> FloatArray:
    return np.asarray((uv - [camera.cx, camera.cy]) / [camera.fx, camera.fy])


def _random_rotation(rng: np.random.Generator, angle_deg: float) -> FloatArray:
    axis = rng.standard_normal(3)
    return rotation_from_vector(np.radians(angle_deg) * axis / np.linalg.norm(axis))


def _cells(camera: Camera, grid: tuple[int, int]) -> list[tuple[FloatArray, FloatArray]]:
    """Lower and upper pixel corners of the grid cells, row by row."""
    size = np.array([camera.width / grid[0], camera.height / grid[1]])
    corners = [np.array([column, row]) * size for row in range(grid[1]) for column in range(grid[0])]
    return [(corner - 0.5, corner + size - 0.5) for corner in corners]


def _terrain(rng: np.random.Generator, centres: FloatArray, slopes: FloatArray, heights: FloatArray) -> FloatArray:
    """(m, 3) scaled normals, 1/height, of planes of given slopes through points at given depths below the camera."""
    azimuth = rng.uniform(0.0, 2.0 * np.pi, len(slopes))
    unit = np.column_stack([np.sin(slopes) * np.cos(azimuth), np.sin(slopes) * np.sin(azimuth), np.cos(slopes)])
    return np.asarray(unit / np.sum(unit * homogeneous(centres), axis=1, keepdims=True) / heights[:, None])


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


def paper_study(
    solvers: Sequence[str] = ("mle", "ha", "lh"),
    trajectories_deg: Sequence[float] = PAPER_TRAJECTORIES_DEG,
    noises_px: Sequence[float] = PAPER_NOISES_PX,
    terrains: int = PAPER_TERRAINS,
    seed: int = 0,
) -> Iterator[Trial]:
    """Run the simulation study of section 4.1: every solver on the same scenes; 1320 scenes by default.

    The terrain of one number is the same for every trajectory and noise level, the noise is drawn anew.
    """
    for i, trajectory in enumerate(trajectories_deg):
        for k, noise in enumerate(noises_px):
            for terrain in range(terrains):
                noise_rng = np.random.default_rng([seed, terrain, i, k])
                scene = paper_scene(np.random.default_rng([seed, terrain]), trajectory, noise, noise_rng)
                yield from (run_trial(scene, solver, trajectory, noise, terrain) for solver in solvers)


def run_trial(scene: Scene, solver: str, trajectory_deg: float, noise_px: float, terrain: int) -> Trial:
    """Solve one scene and compare with its truth (the paper's three error measures)."""
    try:
        solution = solve_planes(scene.x1, scene.x2, scene.patch, solver)  # type: ignore[arg-type]
    except SlopemapError as error:
        nothing = np.full(len(scene.normals), np.nan)
        return Trial(solver, trajectory_deg, noise_px, terrain, np.nan, np.nan, nothing, 0, False, str(error))
    return Trial(
        solver,
        trajectory_deg,
        noise_px,
        terrain,
        float(rotation_angle(solution.R, scene.R)),
        float(direction_angle(solution.T, scene.T)),
        normal_angle(solution.scaled_normals, scene.normals),
        solution.iterations,
        solution.converged,
    )
