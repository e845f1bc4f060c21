"""Image pairs of known motion and planes: every pixel from the exact ray, through a texture with no finer detail.

The texture is painted on what image 1 sees, in pixels of the ideal (undistorted) camera 1, so image 1 looks alike
however the ground is tilted, and image 2 shows whatever the motion and the planes make of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry import homogeneous, pixels_from_rays, rays_from_pixels, rotation_from_vector
from slopecli.types import Camera, FloatArray, IntArray

Grey = NDArray[np.uint8]
Box = tuple[float, float, float, float]  # x, y, width, height in px of image 1

OVERSAMPLED = 4  # texels a pixel: interpolating between them errs by less than a thousandth of the contrast
PERIOD_PX = 512
FINEST_PX, COARSEST_PX = 6.0, 50.0  # wavelengths of the texture
MEAN_GREY, SIGMA_GREY = 128.0, 35.0
REMAP_COLUMNS = 1024  # OpenCV maps no images of more than 32767 columns
FIXED_POINT_STEPS = 12  # to meet a bumpy surface; each reduces the error by the slope of the bumps


def make_camera(width: int = 320, height: int = 240, **changes: object) -> Camera:
    """A camera whose longer side sees 60 degrees."""
    focal = max(width, height) / 2 / np.tan(np.radians(30))
    values = {"fx": focal, "fy": focal, "cx": (width - 1) / 2, "cy": (height - 1) / 2}
    return Camera(width, height, **{**values, **changes})  # type: ignore[arg-type]


def turn(x_deg: float = 0.0, y_deg: float = 0.0, z_deg: float = 0.0) -> FloatArray:
    """Rotation (3, 3) about an axis, deg."""
    return rotation_from_vector(np.radians([x_deg, y_deg, z_deg]))


def unit(*v: float) -> FloatArray:
    return np.array(v) / np.linalg.norm(v)


def tilted(x: float, y: float, distance: float = 6.0) -> FloatArray:
    """Scaled normal (3,) of a plane `distance` baselines off, rising to the right and down by these tangents."""
    return np.array([x, y, 1.0]) / distance


@lru_cache(maxsize=4)
def texture(seed: int) -> NDArray[np.float32]:
    """Endless (periodic) random texture, mean 0 and sigma 1, OVERSAMPLED texels a pixel."""
    side = PERIOD_PX * OVERSAMPLED
    spectrum = np.fft.rfft2(np.random.default_rng(seed).standard_normal((side, side)))
    v, u = np.fft.fftfreq(side, 1 / OVERSAMPLED), np.fft.rfftfreq(side, 1 / OVERSAMPLED)
    frequency = np.hypot(v[:, None], u)
    band = (frequency >= 1 / COARSEST_PX) & (frequency <= 1 / FINEST_PX)
    values = np.fft.irfft2(np.where(band, spectrum / np.maximum(frequency, 1 / COARSEST_PX), 0))
    return np.asarray(values / values.std(), np.float32)


def texture_at(uv: FloatArray, seed: int = 0) -> FloatArray:
    """Values (...) of the texture at pixels (..., 2)."""
    texel = np.mod(np.asarray(uv, float), PERIOD_PX) * OVERSAMPLED
    rows = np.zeros((-(-texel[..., 0].size // REMAP_COLUMNS), REMAP_COLUMNS, 2), np.float32)
    rows.reshape(-1, 2)[: texel[..., 0].size] = texel.reshape(-1, 2)
    found = cv2.remap(texture(seed), rows[..., 0], rows[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
    return np.asarray(found, float).ravel()[: texel[..., 0].size].reshape(texel.shape[:-1])


def to_grey(values: FloatArray) -> Grey:
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def pixel_grid(width: int, height: int) -> FloatArray:
    """(height, width, 2) pixel centres."""
    y, x = np.mgrid[:height, :width]
    return np.stack([x, y], -1).astype(float)


def warped_pair(
    back: Callable[[FloatArray], FloatArray], size: tuple[int, int] = (320, 240), seed: int = 0
) -> tuple[Grey, Grey]:
    """Images of the bare texture, `back` (n, 2) -> (n, 2) taking pixels of image 2 to those of image 1."""
    grid = pixel_grid(*size)
    values = texture_at(grid, seed), texture_at(back(grid.reshape(-1, 2)).reshape(grid.shape), seed)
    first, second = (to_grey(MEAN_GREY + SIGMA_GREY * v) for v in values)
    return first, second


@dataclass(frozen=True, eq=False)
class Surface:
    """A plane of scaled normal (3,), 1/baseline, that image 1 shows inside `box` (None: everywhere).

    bump : what its inverse depth adds to the plane's, (n, 2) px of image 1 -> (n,) 1/baseline.
    contrast : of its texture, relative; 0 is bare ground.  coarseness : of its texture; 16 is the shading of a wall.
    """

    normal: FloatArray
    box: Box | None = None
    bump: Callable[[FloatArray], FloatArray] | None = None
    contrast: float = 1.0
    coarseness: float = 1.0

    def shows(self, uv1: FloatArray) -> NDArray[np.bool_]:
        if self.box is None:
            return np.ones(len(uv1), bool)
        x, y, w, h = self.box
        u, v = uv1.T
        return np.asarray((u >= x - 0.5) & (u < x + w - 0.5) & (v >= y - 0.5) & (v < y + h - 0.5))

    def inverse_depth(self, x1: FloatArray, uv1: FloatArray) -> FloatArray:
        return np.asarray(homogeneous(x1) @ self.normal + self._bump(uv1))

    def _bump(self, uv1: FloatArray) -> FloatArray:
        return np.zeros(len(uv1)) if self.bump is None else self.bump(uv1)


@dataclass(frozen=True, eq=False)
class Pair:
    """Two images and the truth. Later surfaces lie on top of earlier ones, or in holes cut into them."""

    grey1: Grey
    grey2: Grey
    camera1: Camera
    camera2: Camera
    R: FloatArray
    T: FloatArray
    surfaces: tuple[Surface, ...]

    def surface_at(self, uv1: FloatArray) -> IntArray:
        """(n,) index of the surface that image 1 shows at pixels (n, 2)."""
        found = np.zeros(len(uv1), np.int64)
        for k, surface in enumerate(self.surfaces):
            found[surface.shows(uv1)] = k
        return found

    def inverse_depth(self, uv1: FloatArray) -> FloatArray:
        """(n,) true inverse depth, 1/baseline, of what image 1 shows at pixels (n, 2)."""
        x1, shown = rays_from_pixels(self.camera1, uv1), self.surface_at(uv1)
        every = np.array([surface.inverse_depth(x1, uv1) for surface in self.surfaces])
        return np.asarray(every[shown, np.arange(len(uv1))])

    def rays2(self, uv1: FloatArray) -> FloatArray:
        """(n, 2) where image 2 sees, or would see, what image 1 shows at pixels (n, 2); normalised."""
        rays = homogeneous(rays_from_pixels(self.camera1, uv1))
        moved = (rays - self.inverse_depth(uv1)[:, None] * self.T) @ self.R.T
        return np.asarray(moved[:, :2] / moved[:, 2:])

    def transfer(self, uv1: FloatArray) -> FloatArray:
        """The same in pixels of image 2."""
        return pixels_from_rays(self.camera2, self.rays2(uv1))

    def hidden(self, uv1: FloatArray) -> NDArray[np.bool_]:
        """(n,) whether something nearer covers it in image 2."""
        seen, _ = _cast(self, self.rays2(uv1))
        return np.asarray(np.linalg.norm(seen - uv1, axis=1) > 0.01)

    def error_px(self, uv1: FloatArray, uv2: FloatArray) -> FloatArray:
        """(n,) distance of matches from the truth, px of image 2."""
        return np.linalg.norm(uv2 - self.transfer(uv1), axis=1)


def render(
    R: FloatArray,
    T: FloatArray,
    surfaces: Sequence[Surface | FloatArray],
    *,
    camera1: Camera | None = None,
    camera2: Camera | None = None,
    seed: int = 0,
    gain: float = 1.0,
    offset: float = 0.0,
    noise: float = 0.0,
    noise_seed: int = 0,
    coarseness: float = 1.0,
) -> Pair:
    """Render a pair. A surface may be given by its normal alone.

    gain, offset : of image 2.  noise : grey levels.  coarseness : of the texture; 2 for images of up to 1024 px.
    """
    ground = tuple(s if isinstance(s, Surface) else Surface(s) for s in surfaces)
    first = camera1 or make_camera()
    second = camera2 or first
    blank = np.zeros((0, 0), np.uint8)
    pair = Pair(blank, blank, first, second, R, np.asarray(T, float), ground)
    uv1 = pixel_grid(first.width, first.height).reshape(-1, 2)
    rays2 = rays_from_pixels(second, pixel_grid(second.width, second.height).reshape(-1, 2))
    values1 = _paint(pair, uv1, pair.surface_at(uv1), seed, coarseness)
    values2 = gain * _paint(pair, *_cast(pair, rays2), seed, coarseness) + offset
    rng = np.random.default_rng(noise_seed + 1000)
    grey1, grey2 = (
        to_grey(
            values.reshape(camera.height, camera.width) + noise * rng.standard_normal((camera.height, camera.width))
        )
        for values, camera in ((values1, first), (values2, second))
    )
    return Pair(grey1, grey2, first, second, R, pair.T, ground)


def _paint(pair: Pair, uv1: FloatArray, shown: IntArray, seed: int, coarseness: float) -> FloatArray:
    camera, x1 = pair.camera1, rays_from_pixels(pair.camera1, uv1)
    ideal = x1 * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    # every surface has a part of the texture of its own, or what is hidden in image 1 would look like what hides it
    own_part = np.array([[173.0, 71.0]]) * shown[:, None]
    contrast = np.array([surface.contrast for surface in pair.surfaces])[shown]
    coarse = coarseness * np.array([surface.coarseness for surface in pair.surfaces])[shown][:, None]
    return MEAN_GREY + SIGMA_GREY * contrast * texture_at(np.nan_to_num(ideal) / coarse + own_part, seed)


def _cast(pair: Pair, x2: FloatArray) -> tuple[FloatArray, IntArray]:
    """What rays (n, 2) of image 2 meet first: its pixels (n, 2) of image 1 and its surface (n,)."""
    rays = homogeneous(x2) @ pair.R
    nearest = np.full(len(x2), np.inf)
    uv1, shown = np.full((len(x2), 2), -1e3), np.zeros(len(x2), np.int64)
    for k, surface in enumerate(pair.surfaces):
        found, depth = _meet(pair, surface, rays)
        met = (depth > 0) & surface.shows(found) & ~_cut_away(pair, k, found)
        met &= depth < nearest * (1 + 1e-9)
        nearest[met], uv1[met], shown[met] = depth[met], found[met], k
    return uv1, shown


def _meet(pair: Pair, surface: Surface, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
    uv1 = np.full((len(rays), 2), -1e3)
    depth = np.zeros(len(rays))
    bump = np.zeros(len(rays))
    for _ in range(FIXED_POINT_STEPS if surface.bump else 1):
        # the bump tilts nothing: at one ray of image 1 it is a plane of another normal
        normal = surface.normal + bump[:, None] * [0.0, 0.0, 1.0]
        depth = (1 - normal @ pair.T) / np.einsum("ij,ij->i", normal, rays)
        point = depth[:, None] * rays + pair.T
        ahead = point[:, 2] > 1e-6
        x1 = np.where(ahead[:, None], point[:, :2] / np.where(ahead, point[:, 2], 1.0)[:, None], -1e3)
        uv1 = pixels_from_rays(pair.camera1, x1)
        depth = np.where(ahead & np.isfinite(uv1).all(1), depth, -1.0)
        bump = surface._bump(uv1)
    return uv1, depth


def _cut_away(pair: Pair, k: int, uv1: FloatArray) -> NDArray[np.bool_]:
    """Where a later surface lies behind surface k: image 1 sees it through a hole."""
    x1 = rays_from_pixels(pair.camera1, uv1)
    own = pair.surfaces[k].inverse_depth(x1, uv1)
    later = [s.shows(uv1) & (s.inverse_depth(x1, uv1) < own * (1 - 1e-9)) for s in pair.surfaces[k + 1 :]]
    return np.any(later, axis=0) if later else np.zeros(len(uv1), bool)
