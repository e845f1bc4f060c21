"""Pairs of random terrain of a wanted roughness, seen on a random flight, and the truth about every pixel.

Smaller and quicker than the sample pairs, so that hundreds of windows can be asked about. What is random comes from the
seed alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from descent_pair import render_view, total_least_squares_plane, visible_from
from heightfield import RayCaster
from numpy.typing import NDArray
from rendering import FloatArray, View, develop, relative_motion, rotation_about, spectral_noise
from terrain import ALTITUDE, add_rock, light, place_facets, scatter_rocks

SIDE_PX = 400
CELL, SIZE = 0.022, 1024  # m between grid points, about half the footprint of a pixel; grid points a side
STEEPEST_DEG = 22.0


@dataclass(frozen=True)
class Ground:
    """undulation_m, hollows_m: RMS of relief 1 to 4 m and 0.2 to 0.8 m wide; rocks on the site; contrast of texture."""

    undulation_m: float
    hollows_m: float
    rocks: int
    contrast: float = 1.0


GROUNDS = {
    "smooth": Ground(0.003, 0.002, 0),
    "undulating": Ground(0.08, 0.01, 0),
    "rough": Ground(0.04, 0.025, 150),
    "rocky": Ground(0.03, 0.01, 900),
    "faint": Ground(0.02, 0.003, 40, 0.15),
}


@dataclass(frozen=True, eq=False)
class TerrainPair:
    """images; camera: content of a native camera file; R (3, 3), T (3,) in m of P2 = R (P1 - T); points (h, w, 3) m in
    camera 1 at its pixel centres; seen (h, w): whether image 2 shows them."""

    images: tuple[NDArray[np.uint8], NDArray[np.uint8]]
    camera: dict[str, object]
    R: FloatArray
    T: FloatArray
    points: FloatArray
    seen: NDArray[np.bool_]

    def normal(self, window: tuple[int, int, int, int]) -> FloatArray:
        """(3,) towards camera 1, of the plane nearest to all points of a window (x, y, w, h), hidden ones too."""
        x, y, w, h = window
        return total_least_squares_plane(self.points[y : y + h, x : x + w].reshape(-1, 3))[0]

    def visible_share(self, window: tuple[int, int, int, int]) -> float:
        x, y, w, h = window
        return float(self.seen[y : y + h, x : x + w].mean())


def random_pair(ground: Ground, seed: int) -> TerrainPair:
    """One site and one flight over it."""
    rng = np.random.default_rng(seed)
    height, radiance = random_site(rng, ground)
    first, second = random_views(rng)
    caster = RayCaster(height, CELL)
    (radiance1, world), (radiance2, _) = (render_view(view, caster, radiance) for view in (first, second))
    images = tuple(develop(values, 1.4, rng) for values in (radiance1, radiance2))
    R, T = relative_motion(first, second)
    seen = visible_from(second, caster, world)
    return TerrainPair(images, first.camera_file(), R, T, first.to_camera(world), seen)  # type: ignore[arg-type]


def random_site(rng: np.random.Generator, ground: Ground) -> tuple[FloatArray, FloatArray]:
    """height (n, n) m and radiance (n, n): facets of random tilt, relief, rocks; dust, grain and light."""
    x = (np.arange(SIZE) - SIZE / 2) * CELL
    height = random_facets(rng, x)
    height += ground.undulation_m * spectral_noise(rng, SIZE, 4 / CELL, 1 / CELL, 1.0)
    height += ground.hollows_m * spectral_noise(rng, SIZE, 0.8 / CELL, 0.2 / CELL, 1.0)
    base, stone = height.copy(), np.zeros_like(height)
    for rock in scatter_rocks(rng, ground.rocks, extent=SIZE * CELL / 2 - 0.6, smallest=0.06):
        add_rock(height, stone, x, base, rock)
    tone = 0.2 * spectral_noise(rng, SIZE, 300, 20, 1.2) + 0.3 * spectral_noise(rng, SIZE, 24, 5, 0.5)
    tone = ground.contrast * tone + np.where(stone > 0, 0.9 * (stone - 1), 0)
    return height, 0.21 * light(height, CELL) * np.exp(tone)


def random_facets(rng: np.random.Generator, x: FloatArray) -> FloatArray:
    """(n, n) heights of nine planes of random tilt, blended over two metres where they meet."""
    steepness, azimuth = np.tan(np.deg2rad(rng.uniform(0, STEEPEST_DEG, 9))), rng.uniform(0, 2 * np.pi, 9)
    gradient = steepness[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    total, weights = np.zeros((len(x), len(x))), np.zeros((len(x), len(x)))
    for g, c, z in zip(gradient, *place_facets(gradient), strict=True):
        dx, dy = (x - c[0])[None, :], (x - c[1])[:, None]
        weight = np.exp(-(dx**2 + dy**2) / 5)
        total += weight * (z + g[0] * dx + g[1] * dy)
        weights += weight
    return np.asarray(total / weights)


def random_views(rng: np.random.Generator) -> tuple[View, View]:
    """Camera 1 looks down, within some degrees; camera 2 is 10 to 20 % of the height on, 0 to 90 degrees from down."""
    focal = float(SIDE_PX / 2 / np.tan(np.deg2rad(30)))
    trajectory, azimuth = np.deg2rad(rng.uniform(0, 90)), rng.uniform(0, 2 * np.pi)
    baseline = ALTITUDE * rng.uniform(0.1, 0.2)
    level = baseline * np.sin(trajectory)
    second = np.array([level * np.cos(azimuth), level * np.sin(azimuth), ALTITUDE - baseline * np.cos(trajectory)])
    down = np.diag([1.0, -1.0, -1.0])
    turns = [
        rotation_about("z", rng.uniform(-3, 3)) @ rotation_about("y", a) @ rotation_about("x", b)
        for a, b in rng.uniform(-3, 3, (2, 2))
    ]
    views = zip(turns, (np.array([0.0, 0.0, ALTITUDE]), second), strict=True)
    first, other = (View(SIDE_PX, SIDE_PX, focal, turn @ down, centre) for turn, centre in views)
    return first, other
