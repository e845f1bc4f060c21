"""Simulated scenes with known motion and planes, as in the paper's section 4.1; tests use them too.

What the paper leaves open, and what is chosen here: the distribution of terrain slopes (uniform in 0..40 deg, any
downhill azimuth), the height of the patches (their centres within 5 % of the nominal ground), the rotation between the
images (5 deg about a random axis), the direction of horizontal flight (image x, from window 3 towards window 5) and
where in its window a point lies (uniform in the image). The nominal camera looks straight down, so `up` is (0, 0, -1).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous, normal_angle, rotation_from_vector
from slopecli.geometry.slope import CAMERA_UP
from slopecli.types import BoolArray, Camera, FloatArray, IntArray

UP = CAMERA_UP


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
        """(n, 2) pixels of image 1, as the lens distorts them."""
        return pixels_from_rays(self.camera, self.x1)

    @property
    def uv2(self) -> FloatArray:
        """(n, 2) pixels of image 2, as the lens distorts them."""
        return pixels_from_rays(self.camera, self.x2)


def field_of_view_camera(width: int = 1024, height: int = 1024, fov_deg: float = 60.0) -> Camera:
    """Pinhole camera with the given horizontal field of view; by default the paper's."""
    focal = 0.5 * width / float(np.tan(np.radians(fov_deg) / 2.0))
    return Camera(width, height, focal, focal, (width - 1) / 2.0, (height - 1) / 2.0, source="simulated")


def paper_scene(
    rng: np.random.Generator, trajectory_deg: float, noise_px: float, noise_rng: np.random.Generator | None = None
) -> Scene:
    """One trial of section 4.1: 3x3 patches of 30 points, baseline one fifth of the height, noise in image 2 only.

    trajectory_deg : angle of the flight from the vertical; 0 descends, 45 glides, 90 flies level.
    """
    return make_scene(rng, trajectory_deg=trajectory_deg, noise_px=noise_px, noise_rng=noise_rng)


@dataclass(frozen=True, eq=False)
class Ground:
    """What camera 1 sees: planes, one in each cell of a grid over image 1, and points on them; lengths in heights.

    x1 (n, 2); inverse_depth (n,), 1/height; patch (n,), -1 = on no plane; normals (m, 3) scaled, 1/height; relief as
    of `Scene`.
    """

    camera: Camera
    x1: FloatArray
    inverse_depth: FloatArray
    patch: IntArray
    normals: FloatArray
    relief: float


def make_scene(
    rng: np.random.Generator,
    *,
    trajectory_deg: float = 45.0,
    heading_deg: float = 0.0,
    baseline_over_height: float = 0.2,
    rotation_deg: float = 5.0,
    noise_px: float = 0.3,
    noise1_px: float = 0.0,
    outliers: float = 0.0,
    outlier_px: float = 40.0,
    noise_rng: np.random.Generator | None = None,
    **ground: Any,
) -> Scene:
    """A downward-looking scene: one plane in each cell of a grid over image 1, seen again after a known motion.

    Parameters
    ----------
    rng : source of every random choice; the same generator state gives the same scene.
    trajectory_deg : angle of the flight from the vertical, 0 descends.  heading_deg : of its horizontal part, from
        image x towards image y.
    rotation_deg : between the images, about a random axis.
    noise_px, noise1_px : 1-sigma of a coordinate in images 2 and 1, px of the image without distortion.
    outliers : share of patch and free points moved by up to outlier_px in each image-2 coordinate.
    noise_rng : source of noise and outliers, to see one terrain under many noises; None goes on with `rng`.
    ground : options of `make_ground`.

    Raises
    ------
    InputError : a plane is too steep to be seen everywhere in its cell, or camera 2 does not see a point.
    """
    R = _random_rotation(rng, rotation_deg)
    seen = make_ground(rng, **ground)
    tilt, heading = np.radians(trajectory_deg), np.radians(heading_deg)
    position = np.array([np.sin(tilt) * np.cos(heading), np.sin(tilt) * np.sin(heading), np.cos(tilt)])
    rng = noise_rng or rng
    return _observe(seen, R, baseline_over_height * position, rng, noise_px, noise1_px, outliers, outlier_px)


def make_sequence(
    rng: np.random.Generator,
    positions: FloatArray,
    *,
    rotation_deg: float = 5.0,
    noise_px: float = 0.3,
    noise1_px: float = 0.0,
    **ground: Any,
) -> list[Scene]:
    """One ground seen by several cameras: a scene for image 1 with each of the others, which share image 1.

    positions : (k, 3) of cameras 2, 3, ... in camera-1 axes, heights above the ground; each turned by rotation_deg
        about an axis of its own. Normals are in 1/baseline of their own pair, so they differ by a factor only.
    ground : options of `make_ground`. InputError as of `make_scene`, or where a camera stands where camera 1 does.
    """
    seen = make_ground(rng, **ground)
    x1 = _with_noise(rng, seen.x1, noise1_px / seen.camera.focal_px)
    turned = [(np.asarray(place, float), _random_rotation(rng, rotation_deg)) for place in positions]
    scenes = [_observe(seen, R, place, rng, noise_px, noise1_px) for place, R in turned]
    return [replace(scene, x1=x1) for scene in scenes]


def make_ground(
    rng: np.random.Generator,
    *,
    camera: Camera | None = None,
    grid: tuple[int, int] = (3, 3),
    points: int = 30,
    slopes_deg: Sequence[float] | None = None,
    max_slope_deg: float = 40.0,
    height_spread: float = 0.05,
    relief: float = 0.0,
    free_points: int = 0,
) -> Ground:
    """Planes and points as camera 1 sees them.

    Parameters
    ----------
    camera : of both images, distorted or not; None: the paper's.  grid : (columns, rows) of patches, each of `points`.
    slopes_deg : slope of each patch, row by row; None draws them uniformly from 0..max_slope_deg.
    height_spread : patch centres lie this part of the height above or below the nominal ground, uniformly.
    relief : RMS height of points off their plane over its distance.  free_points : on no plane, depths within 20 %.

    Raises
    ------
    InputError : a plane is too steep to be seen everywhere in its cell, or the lens does not reach the image's corners.
    """
    camera = camera or field_of_view_camera()
    m = grid[0] * grid[1]
    size = np.array([camera.width / grid[0], camera.height / grid[1]])
    corners = [np.array([column, row]) * size for row in range(grid[1]) for column in range(grid[0])]
    uv = np.concatenate([rng.uniform(low - 0.5, low + size - 0.5, (points, 2)) for low in corners])
    patch = np.repeat(np.arange(m), points)
    slopes = rng.uniform(0.0, max_slope_deg, m) if slopes_deg is None else np.asarray(slopes_deg, dtype=float)
    if len(slopes) != m:
        raise InputError(f"{len(slopes)} slopes given for {m} patches; give one for each, row by row")
    centres = _rays(camera, np.array([(low - 0.5 + (low + size - 0.5)) / 2.0 for low in corners]))
    heights = 1.0 + rng.uniform(-height_spread, height_spread, m)
    normals = _terrain(rng, centres, np.radians(slopes), heights)
    x1 = _rays(camera, uv)
    # eq. (1): N.P = 1
    inverse_depth = np.sum(normals[patch] * homogeneous(x1), axis=1) / (1.0 + relief * rng.standard_normal(len(x1)))
    if free_points:
        uv_free = rng.uniform([0.0, 0.0], [camera.width - 1.0, camera.height - 1.0], (free_points, 2))
        x1 = np.concatenate([x1, _rays(camera, uv_free)])
        inverse_depth = np.append(inverse_depth, 1.0 / rng.uniform(0.8, 1.2, free_points))
        patch = np.append(patch, np.full(free_points, -1))
    if (inverse_depth <= 0.0).any():
        raise InputError(
            "a plane is too steep to be seen everywhere in its cell; lower the slopes or the field of view"
        )
    return Ground(camera, x1, inverse_depth, patch, normals, relief)


def _observe(
    ground: Ground,
    R: FloatArray,
    position: FloatArray,
    rng: np.random.Generator,
    noise_px: float,
    noise1_px: float,
    outliers: float = 0.0,
    outlier_px: float = 0.0,
) -> Scene:
    """The ground seen again by a camera at `position` (3,), heights, turned by R."""
    baseline, focal = float(np.linalg.norm(position)), ground.camera.focal_px
    if baseline == 0.0:
        raise InputError("camera 2 is where camera 1 is; give it another position")
    T = position / baseline
    x1, normals, inverse_depth = ground.x1, ground.normals * baseline, ground.inverse_depth * baseline
    if ((homogeneous(x1) - inverse_depth[:, None] * T) @ R[2] <= 0.0).any():
        raise InputError("camera 2 is below the ground or turned away from it; lower the baseline or the rotation")
    x2 = project(R, T, x1, inverse_depth)
    outlier = rng.random(len(x1)) < outliers
    jumps = outlier[:, None] * rng.uniform(-outlier_px, outlier_px, x2.shape) / focal
    sigmas = noise_px / focal, noise1_px / focal
    found1 = _with_noise(rng, x1, sigmas[1])
    found2 = _with_noise(rng, x2, sigmas[0]) + jumps
    return Scene(ground.camera, R, T, normals, found1, found2, x1, x2, ground.patch, *sigmas, ground.relief, outlier)


def _with_noise(rng: np.random.Generator, x: FloatArray, sigma: float) -> FloatArray:
    return np.asarray(x + sigma * rng.standard_normal(x.shape))


def project(R: FloatArray, T: FloatArray, x1: FloatArray, inverse_depth: FloatArray) -> FloatArray:
    """Where image 2 sees the points x1 (n, 2) of image 1: P2 = R (P1 - T), inverse_depth (n,) in 1/baseline."""
    y = (homogeneous(x1) - inverse_depth[:, None] * T) @ R.T  # eq. (2), divided by the depth
    return np.asarray(y[:, :2] / y[:, 2:])


def _rays(camera: Camera, uv: FloatArray) -> FloatArray:
    x = rays_from_pixels(camera, uv)
    if not np.isfinite(x).all():
        raise InputError("the lens model does not reach the corners of the image; give a smaller image or another lens")
    return x


def _random_rotation(rng: np.random.Generator, angle_deg: float) -> FloatArray:
    axis = rng.standard_normal(3)
    return rotation_from_vector(np.radians(angle_deg) * axis / np.linalg.norm(axis))


def _terrain(rng: np.random.Generator, centres: FloatArray, slopes: FloatArray, heights: FloatArray) -> FloatArray:
    """(m, 3) scaled normals, 1/height, of planes of given slopes through points at given depths below the camera."""
    azimuth = rng.uniform(0.0, 2.0 * np.pi, len(slopes))
    unit = np.column_stack([np.sin(slopes) * np.cos(azimuth), np.sin(slopes) * np.sin(azimuth), np.cos(slopes)])
    return np.asarray(unit / np.sum(unit * homogeneous(centres), axis=1, keepdims=True) / heights[:, None])
