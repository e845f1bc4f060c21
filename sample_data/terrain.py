"""A rocky landing site: a heightfield and the light that leaves it.

The surface is Lambertian and the sun does not move, so the light leaving a point is the same in every image; it is
computed once on the grid and only looked up where the rays hit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from rendering import FloatArray, spectral_noise

SEED = 20130
CELL = 0.0075  # m; below half the footprint of a pixel from 11 m, so that the finest texture is the image's, not ours
SIZE = 2816  # cells
SUN_STEP = (4, 3)  # cells towards the sun; 5 cells long, so that shadows can be swept on whole cells
SUN_ELEVATION_DEG = 34.0

# Inclinations of the facets' columns to the east and of their rows to the north, degrees. Neighbours that share the
# inclination along their common edge meet without a cliff, so a small scatter is all that is added to each facet.
COLUMNS_DEG, ROWS_DEG, SCATTER_DEG = (1.5, -11.0, 17.0), (8.0, -19.0, 2.5), 1.8
ALTITUDE = 13.0  # m of camera 1 above the middle facet
CELL_ANGLE = 0.385  # tangent of the angle between the middles of two cells, a third of a 60 degree field of view
NEIGHBOURS = [(k, k + 1) for k in range(9) if k % 3 < 2] + [(k, k + 3) for k in range(6)]

# x, y, radius in metres; the large ones lie where cells meet or near the border
CRATERS = [
    (-2.35, -6.1, 0.72), (6.1, 2.55, 0.55), (-6.2, 2.5, 0.62), (2.7, -2.5, 0.42), (-0.9, 5.6, 0.34),
    (-4.2, -1.1, 0.24), (0.9, 1.5, 0.2), (4.9, 5.4, 0.28), (1.8, -4.9, 0.18), (-1.9, -2.6, 0.3), (5.6, -6.0, 0.45),
]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Terrain:
    """height (n, n) m and radiance (n, n) at grid points; x of column j is (j - n/2) CELL, y of row i likewise."""

    height: FloatArray
    radiance: FloatArray


def build_terrain() -> Terrain:
    """The whole site: facets, relief, craters and rocks, then albedo and light."""
    rng = np.random.default_rng(SEED)
    x = (np.arange(SIZE, dtype=np.float64) - SIZE / 2) * CELL
    height = facets(rng, x) + relief(rng)
    for crater in CRATERS:
        add_crater(height, x, *crater)
    smooth = height.copy()
    stone = np.zeros_like(height)
    for rock in scatter_rocks(rng):
        add_rock(height, stone, x, smooth, rock)
    return Terrain(height, light(height) * albedo(rng, stone))


def facets(rng: np.random.Generator, x: FloatArray) -> FloatArray:
    """Nine tilted planes, one where camera 1 sees each cell of a 3x3 grid, blended over a metre where they meet."""
    tilt = np.stack([t.ravel() for t in np.meshgrid(COLUMNS_DEG, ROWS_DEG)], axis=1)
    gradient = np.tan(np.deg2rad(tilt + rng.normal(0, SCATTER_DEG, (9, 2))))
    centre, height = place_facets(gradient)
    total, weights = np.zeros((SIZE, SIZE)), np.zeros((SIZE, SIZE))
    wander = 0.2 * spectral_noise(rng, SIZE, 900, 220, 1.5)  # m, so that the edges are not straight
    for g, c, z in zip(gradient, centre, height, strict=True):
        dx, dy = (x - c[0])[None, :], (x - c[1])[:, None]
        weight = np.exp(-((dx + wander) ** 2 + (dy + wander) ** 2) / 2.2)  # a soft Voronoi cell once normalised
        total += weight * (z + g[0] * dx + g[1] * dy)
        weights += weight
    return total / weights


def place_facets(gradient: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centres (9, 2) and heights (9,) of the facets, each in the middle of its cell as seen from 13 m."""
    column, row = np.meshgrid([-CELL_ANGLE, 0.0, CELL_ANGLE], [CELL_ANGLE, 0.0, -CELL_ANGLE])
    rays, height = np.stack([column.ravel(), row.ravel()], axis=1), np.zeros(9)
    for _ in range(5):  # where a ray meets a facet depends on the facet's height, and the other way round, but weakly
        centre = rays * (ALTITUDE - height)[:, None]
        height = facet_heights(gradient, centre)
    return centre, height


def facet_heights(gradient: FloatArray, centre: FloatArray) -> FloatArray:
    """Heights (9,) of the facets' centres, the middle one 0, that make neighbours meet half-way as well as can be."""
    rows, values = [100 * np.eye(9)[4]], [0.0]
    for i, j in NEIGHBOURS:
        rows.append(np.eye(9)[i] - np.eye(9)[j])
        values.append((gradient[i] + gradient[j]) @ (centre[i] - centre[j]) / 2)
    return np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)[0]


def relief(rng: np.random.Generator) -> FloatArray:
    """Fractal bumps: undulation of a few cm, and roughness of mm that shows in the shading."""
    undulation = spectral_noise(rng, SIZE, 300, 30, 1.6)
    roughness = spectral_noise(rng, SIZE, 40, 5, 1.0)
    patchy = np.clip(0.6 + 0.5 * spectral_noise(rng, SIZE, 500, 120, 1.0), 0.1, 2)
    return 0.015 * undulation + 0.0048 * patchy * roughness


def add_crater(height: FloatArray, x: FloatArray, cx: float, cy: float, radius: float) -> None:
    """A fresh simple crater: bowl a fifth of the diameter deep, raised rim, ejecta falling off as r^-3."""
    columns, rows = (slice(*np.searchsorted(x, [c - 4 * radius, c + 4 * radius])) for c in (cx, cy))
    dx, dy = (x[columns] - cx)[None, :] / radius, (x[rows] - cy)[:, None] / radius
    r = np.hypot(dx, dy) * (1 + 0.05 * np.sin(3 * np.arctan2(dy, dx) + 40 * cx))
    bowl = 0.42 * (r**2.7 - 1) + 0.10
    ejecta = 0.10 * np.maximum(r, 1e-3) ** -3.0 * np.exp(-((np.maximum(r - 1, 0) / 1.2) ** 2))
    height[rows, columns] -= radius * np.logaddexp(-20 * bowl, -20 * ejecta) / 20


@dataclass(frozen=True)
class Rock:
    """Where it lies, its half axes in metres, and the planes (k, 3) that cut it; `shade` is a log-tone."""

    x: float
    y: float
    axes: tuple[float, float, float]
    azimuth: float
    cuts: FloatArray
    shade: float


def scatter_rocks(
    rng: np.random.Generator, count: int = 2600, extent: float = SIZE * CELL / 2 - 0.6, smallest: float = 0.021
) -> list[Rock]:
    """Rocks with a power-law size distribution, the largest first, so that small ones may lie in front of them."""
    radius = np.minimum(smallest * rng.uniform(size=count) ** (-1 / 1.9), 0.40)
    rocks = []
    for r in np.sort(radius)[::-1]:
        cuts = np.concatenate([rng.standard_normal((7, 2)), rng.uniform(0.2, 1.3, (7, 1))], axis=1)
        cuts /= np.linalg.norm(cuts, axis=1, keepdims=True)
        axes = (r, r * rng.uniform(0.6, 1.0), r * rng.uniform(0.45, 0.85))
        x, y = rng.uniform(-extent, extent, 2)
        rocks.append(Rock(x, y, axes, rng.uniform(0, np.pi), cuts, rng.normal(0, 0.22)))
    return rocks


def add_rock(height: FloatArray, stone: FloatArray, x: FloatArray, ground: FloatArray, rock: Rock) -> None:
    """Set a half-ellipsoid with a few planes cut off on the ground; `stone` takes 1 + its shade where it shows."""
    reach = rock.axes[0] * 1.05
    columns, rows = (slice(*np.searchsorted(x, [c - reach, c + reach])) for c in (rock.x, rock.y))
    dx, dy = (x[columns] - rock.x)[None, :], (x[rows] - rock.y)[:, None]
    c, s = np.cos(rock.azimuth), np.sin(rock.azimuth)
    a, b = (c * dx + s * dy) / rock.axes[0], (c * dy - s * dx) / rock.axes[1]
    top = np.sqrt(np.clip(1 - a * a - b * b, 0, None))
    for nx, ny, nz in rock.cuts:
        top = np.minimum(top, (0.80 - nx * a - ny * b) / nz)
    i, j = (int(np.searchsorted(x, value)) for value in (rock.y, rock.x))
    # a quarter of it is buried, which also keeps its sides from being vertical where they meet the ground
    surface = ground[i, j] + rock.axes[2] * (top - 0.25)
    here = height[rows, columns]
    shows = (surface > here) & (a * a + b * b < 1)
    here[shows] = surface[shows]
    stone[rows, columns][shows] = 1 + rock.shade


def albedo(rng: np.random.Generator, stone: FloatArray) -> FloatArray:
    """Reflectance: dust and gravel in patches, grain of one to two pixels, bright and dark pebbles, rocks."""
    patches = spectral_noise(rng, SIZE, 900, 60, 1.2)
    mottle = spectral_noise(rng, SIZE, 120, 8, 0.7)
    grain = spectral_noise(rng, SIZE, 20, 5, 0.4)
    coarse = 1 / (1 + np.exp(-2.5 * spectral_noise(rng, SIZE, 500, 50, 1.0)))
    tone = 0.17 * patches + 0.15 * mottle + (0.15 + 0.16 * coarse) * grain
    pebbles = spectral_noise(rng, SIZE, 14, 4.0, 0.5)
    tone += 0.35 * np.clip(pebbles - 2.2, 0, 1) - 0.45 * np.clip(-pebbles - 2.0, 0, 1) * coarse
    rock_tone = 0.9 * (stone - 1) + 0.14 * mottle + 0.16 * grain + 0.02
    return 0.21 * np.exp(np.where(stone > 0, rock_tone, tone))


def light(height: FloatArray, cell: float = CELL) -> FloatArray:
    """Irradiance of sun and sky on the surface, 1 for level ground in full sun; `cell` m between grid points."""
    dy, dx = np.gradient(height, cell)
    elevation = np.deg2rad(SUN_ELEVATION_DEG)
    towards = np.cos(elevation) * np.array(SUN_STEP) / 5
    norm = np.sqrt(1 + dx * dx + dy * dy)
    facing = np.clip((np.sin(elevation) - towards[0] * dx - towards[1] * dy) / norm, 0, None)
    sun = facing * (1 - shadow(height, cell)) / np.sin(elevation)
    return 0.86 * sun + 0.14 * sky(height, cell) * (0.5 + 0.5 / norm)


def sky(height: FloatArray, cell: float = CELL) -> FloatArray:
    """Openness to the sky: hollows are darker, judged from the height over the mean of the surroundings."""
    from scipy.ndimage import gaussian_filter

    openness = np.zeros_like(height)
    for radius in (6, 24):
        openness += np.tanh((height - gaussian_filter(height, radius, truncate=2.5)) / (radius * cell * 0.5))
    return np.clip(1 + 0.45 * openness, 0.25, 1.4)


def shadow(height: FloatArray, cell: float = CELL) -> FloatArray:
    """Shade 0..1: how far the horizon towards the sun stands above the sun's rays, softened over a few mm.

    The highest obstacle within 2**k steps is found from those within 2**(k-1) steps; the first five sub-steps, of one
    cell each, are interpolated, every later one falls on whole cells.
    """
    drop = np.tan(np.deg2rad(SUN_ELEVATION_DEG)) * cell
    obstacle = np.full_like(height, -np.inf)
    for k in range(1, 6):
        obstacle = np.maximum(obstacle, shifted(height, k * SUN_STEP[0] / 5, k * SUN_STEP[1] / 5) - k * drop)
    for doubling in range(8):
        n = 2**doubling
        obstacle = np.maximum(obstacle, shifted(obstacle, n * SUN_STEP[0], n * SUN_STEP[1]) - 5 * n * drop)
    return np.clip((obstacle - height) / 0.006, 0, 1)


def shifted(grid: FloatArray, dx: float, dy: float) -> FloatArray:
    """The grid seen from (dx, dy) >= 0 cells on, interpolated; the edge is repeated beyond the border."""
    for axis, step in ((1, dx), (0, dy)):
        index = np.arange(grid.shape[axis])
        low, high = (np.minimum(index + int(step) + k, len(index) - 1) for k in (0, 1))
        near = grid.take(low, axis)
        fraction = step - int(step)
        grid = near if fraction == 0 else (1 - fraction) * near + fraction * grid.take(high, axis)
    return grid
