"""Procedural reflectance of a town: linear RGB at metric coordinates (s, t) of a face, s along it and t up it.

Every surface carries noise from the size of a pixel to that of the wall, and every tile, pane and slab its own tone,
so that no two places look the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from rendering import FloatArray, bilinear, spectral_noise

STREETS_X, STREETS_Y = (
    (-7.0, 46.0, -52.0),
    (-5.0, 45.0),
)  # centre lines: x of those to the north, y of those to the east
HALF_ROAD, KERB, PAVEMENT = 3.6, 3.8, 6.0  # m from the centre line


class Grain:
    """Noise textures, unit variance, repeating only beyond the scene, and a table of uniform numbers for tiles."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.layers = {
            "fine": (spectral_noise(rng, 1024, 9, 2.2, 0.4), 0.045),
            "medium": (spectral_noise(rng, 1024, 60, 6, 0.9), 0.08),
            "broad": (spectral_noise(rng, 512, 90, 6, 1.3), 0.4),
        }
        self.table = rng.uniform(size=(97, 101))

    def noise(self, layer: str, s: FloatArray, t: FloatArray, seed: int) -> FloatArray:
        """Noise (n,) at coordinates (n,) in metres, another cut-out for every seed."""
        grid, cell = self.layers[layer]
        size = len(grid)
        column, row = ((axis / cell + offset) % (size - 1) for axis, offset in ((s, 37.3 * seed), (t, 91.7 * seed)))
        return bilinear(grid, column, row)

    def tile(self, i: FloatArray, j: FloatArray, seed: int) -> FloatArray:
        """A number in 0..1 for each tile (i, j)."""
        rows, columns = self.table.shape
        return self.table[(i.astype(np.int64) + 13 * seed) % rows, (j.astype(np.int64) + 29 * seed) % columns]


@dataclass(frozen=True)
class Surface:
    """What a material sees of its face: noise, a seed of its own, and the face's width and eaves height in metres."""

    grain: Grain
    seed: int
    width: float = 0.0
    eaves: float = 0.0

    def noise(self, layer: str, s: FloatArray, t: FloatArray) -> FloatArray:
        return self.grain.noise(layer, s, t, self.seed)

    def tile(self, i: FloatArray, j: FloatArray) -> FloatArray:
        return self.grain.tile(i, j, self.seed)

    def weathered(self, s: FloatArray, t: FloatArray, fine: float, medium: float, broad: float) -> FloatArray:
        """Log-normal gain (n,) of the three layers of noise."""
        layers = (("fine", fine), ("medium", medium), ("broad", broad))
        return np.exp(sum(strength * self.noise(layer, s, t) for layer, strength in layers))


Material = Callable[[Surface, FloatArray, FloatArray], FloatArray]


def tinted(colour: tuple[float, float, float], gain: FloatArray) -> FloatArray:
    """RGB (n, 3) of one colour under a gain (n,)."""
    return np.asarray(colour) * gain[:, None]


def paint(
    colour: tuple[float, float, float], fine: float = 0.03, medium: float = 0.05, broad: float = 0.05
) -> Material:
    """A plain painted, metal or mineral surface."""
    return lambda surface, s, t: tinted(colour, surface.weathered(s, t, fine, medium, broad))


def tiled_roof(colour: tuple[float, float, float], tile: float = 0.3, contrast: float = 0.5) -> Material:
    """Rows of tiles, each of its own shade, darker at the lower edge, mossy in places."""

    def reflectance(surface: Surface, s: FloatArray, t: FloatArray) -> FloatArray:
        row = np.floor(t / (1.15 * tile))
        across = s / tile + 0.5 * (row % 2)
        shade = np.exp(contrast * (surface.tile(np.floor(across), row) - 0.5))
        shade *= np.where(t / (1.15 * tile) - row < 0.16, 0.72, 1.0)
        shade *= 1 + 0.10 * np.cos(2 * np.pi * across)
        moss = np.clip(surface.noise("medium", s, t) + surface.noise("broad", s, t) - 1.2, 0, 1)[:, None]
        return tinted(colour, shade * surface.weathered(s, t, 0.10, 0.08, 0.10)) * (1 - moss * [0.45, 0.25, 0.3])

    return reflectance


def seamed_roof(colour: tuple[float, float, float]) -> Material:
    """Metal sheets 0.55 m wide with standing seams and run-off streaks."""

    def reflectance(surface: Surface, s: FloatArray, t: FloatArray) -> FloatArray:
        sheet = np.floor(s / 0.55)
        seam = s / 0.55 - sheet
        shade = np.exp(0.16 * (surface.tile(sheet, np.floor(t / 2.4)) - 0.5))
        shade *= np.select([seam < 0.08, seam < 0.17], [1.22, 0.66], 1.0)
        streaks = np.exp(0.10 * surface.noise("medium", 3 * s, 0.35 * t))
        return tinted(colour, shade * streaks * surface.weathered(s, t, 0.06, 0.07, 0.08))

    return reflectance


def flat_roof(colour: tuple[float, float, float]) -> Material:
    """Bitumen sheets a metre wide, gravel on them, patches where water stands."""

    def reflectance(surface: Surface, s: FloatArray, t: FloatArray) -> FloatArray:
        sheet = np.floor(t / 1.05)
        shade = np.exp(0.14 * (surface.tile(np.floor(s / 7 + 0.37 * sheet), sheet) - 0.5))
        shade *= np.where(t / 1.05 - sheet < 0.07, 0.8, 1.0)
        puddle = np.clip(surface.noise("broad", s, t) + 0.5 * surface.noise("medium", s, t) - 0.7, 0, 1)
        return tinted(colour, shade * (1 - 0.4 * puddle) * surface.weathered(s, t, 0.17, 0.10, 0.06))

    return reflectance


def masonry(surface: Surface, s: FloatArray, t: FloatArray, length: float, course: float) -> FloatArray:
    """Gain (n,) of bonded blocks with pale joints."""
    row = np.floor(t / course)
    along = s / length + 0.5 * (row % 2)
    joint = (t / course - row < 0.14) | (along - np.floor(along) < 0.08)
    return np.where(joint, 1.25, np.exp(0.55 * (surface.tile(np.floor(along), row) - 0.5)))


def facade(
    wall: tuple[float, float, float],
    blocks: tuple[float, float] | None = None,
    storey: float = 3.0,
    pitch: float = 2.6,
    frame: tuple[float, float, float] = (0.62, 0.61, 0.58),
) -> Material:
    """A wall of plaster, or of blocks (length, course), with a grid of windows and a door here and there."""

    def reflectance(surface: Surface, s: FloatArray, t: FloatArray) -> FloatArray:
        gain = surface.weathered(s, t, 0.07, 0.07, 0.09) * np.exp(0.07 * surface.noise("medium", 2.5 * s, 0.3 * t))
        if blocks:
            gain *= masonry(surface, s, t, *blocks)
        else:
            gain *= np.where((t % storey < 0.12) & (t > storey), 1.18, 1.0)
        gain *= 1 - 0.3 * np.exp(-t / 0.5)
        colour = tinted(wall, gain)
        add_windows(colour, surface, s, t, storey, pitch, frame)
        return colour

    return reflectance


def add_windows(
    colour: FloatArray,
    surface: Surface,
    s: FloatArray,
    t: FloatArray,
    storey: float,
    pitch: float,
    frame: tuple[float, float, float],
) -> None:
    """Paint sills, frames, panes, curtains and doors over a wall's colour (n, 3)."""
    count, floors = int((surface.width - 0.8) / pitch), int(surface.eaves / storey + 0.15)
    margin = (surface.width - count * pitch) / 2
    column, level = np.floor((s - margin) / pitch), np.floor(t / storey)
    x, y = s - margin - (column + 0.5) * pitch, t - level * storey
    which = surface.tile(column, level)
    exists = (column >= 0) & (column < count) & (level < floors) & (which > 0.06)
    door = exists & (level == 0) & (surface.tile(column, level + 50) < 0.22)
    half = np.where(which > 0.8, 0.85, 0.6)
    bottom, top = np.where(door, 0.0, 0.95), np.where(door, 2.15, 2.4)
    opening = exists & (np.abs(x) < half) & (y > bottom) & (y < top)
    sill = exists & ~door & (np.abs(x) < half + 0.12) & (y > 0.80) & (y <= 0.95)
    pane = opening & (np.abs(x) < half - 0.09) & (np.abs(x) > 0.04) & (y > bottom + 0.09) & (y < top - 0.09)
    colour[sill] = np.array(frame) * 0.9
    colour[opening] = frame
    colour[pane] = panes(surface, column[pane], level[pane], x[pane], (y - bottom)[pane] / 1.45)
    door_leaf = door & pane
    colour[door_leaf] = np.array([0.16, 0.09, 0.05]) * (0.6 + surface.tile(column, level + 9)[door_leaf])[:, None]


def panes(surface: Surface, column: FloatArray, level: FloatArray, x: FloatArray, rise: FloatArray) -> FloatArray:
    """RGB (n, 3) of glass: dark, with the sky in its upper part, and a blind or curtain behind some."""
    tone = surface.tile(column, level + 7)[:, None]
    glass = np.array([0.030, 0.040, 0.052]) * (0.6 + 1.8 * tone) * (0.6 + 0.9 * np.clip(rise, 0, 1))[:, None]
    drop = 1.6 * surface.tile(column, level + 21) - 0.6
    blind = (1 - rise < drop) | ((np.abs(x) > 0.32) & (surface.tile(column, level + 33) < 0.35))
    cloth = np.array([0.42, 0.40, 0.35]) * (0.35 + 0.8 * surface.tile(column, level + 41))[:, None]
    return np.where(blind[:, None], cloth, glass)


def foliage(colour: tuple[float, float, float]) -> Material:
    """Leaves: strong fine contrast."""
    return lambda surface, s, t: tinted(colour, surface.weathered(s, t, 0.38, 0.18, 0.0))


def ground(surface: Surface, s: FloatArray, t: FloatArray) -> FloatArray:
    """Lawns, pavements, kerbs and roads with markings; s is the world's x, t its y."""
    to_x, to_y = (nearest(lines, axis) for lines, axis in ((STREETS_X, s), (STREETS_Y, t)))
    street = np.minimum(np.abs(to_x), np.abs(to_y))
    colour = lawn(surface, s, t)
    for limit, layer in ((PAVEMENT, pavement), (KERB, kerb), (HALF_ROAD, road)):
        inside = street < limit
        colour[inside] = layer(surface, s[inside], t[inside])
    marked = (street < HALF_ROAD) & markings(to_x, to_y, s, t)
    worn = np.clip(0.75 - 0.28 * surface.noise("medium", s, t) - 0.16 * surface.noise("fine", s, t), 0.1, 1)
    colour[marked] += ((0.58 - colour) * worn[:, None])[marked]
    return colour


def nearest(lines: tuple[float, ...], axis: FloatArray) -> FloatArray:
    """Signed distance (n,) to the nearest of several parallel lines."""
    distance = axis[:, None] - np.array(lines)
    return np.take_along_axis(distance, np.abs(distance).argmin(axis=1)[:, None], axis=1)[:, 0]


def lawn(surface: Surface, s: FloatArray, t: FloatArray) -> FloatArray:
    """Grass with dry and bare places, and a paved path or yard in some of the gardens."""
    grass = tinted((0.085, 0.125, 0.035), surface.weathered(s, t, 0.26, 0.20, 0.12))
    dry = np.clip(0.6 * surface.noise("broad", s, t) + 0.5 * surface.noise("medium", s, t) - 0.1, 0, 1)[:, None]
    grass += 0.8 * dry * (tinted((0.21, 0.17, 0.09), surface.weathered(s, t, 0.2, 0.1, 0.0)) - grass)
    plot = surface.tile(np.floor(s / 6.5), np.floor(t / 7.5))
    paved = (plot > 0.72) & (s % 6.5 < 4.4)
    grass[paved] = slabs(surface, s[paved], t[paved], 0.6, (0.27, 0.24, 0.21))
    return grass


def slabs(
    surface: Surface, s: FloatArray, t: FloatArray, size: float, colour: tuple[float, float, float]
) -> FloatArray:
    """Square slabs with dark joints."""
    i, j = np.floor(s / size), np.floor(t / size)
    joint = (s / size - i < 0.1) | (t / size - j < 0.1)
    shade = np.where(joint, 0.66, np.exp(0.35 * (surface.tile(i, j) - 0.5)))
    return tinted(colour, shade * surface.weathered(s, t, 0.10, 0.09, 0.07))


def pavement(surface: Surface, s: FloatArray, t: FloatArray) -> FloatArray:
    return slabs(surface, s, t, 0.75, (0.34, 0.33, 0.31))


def kerb(surface: Surface, s: FloatArray, t: FloatArray) -> FloatArray:
    return tinted((0.46, 0.45, 0.43), surface.weathered(s, t, 0.08, 0.05, 0.04))


def road(surface: Surface, s: FloatArray, t: FloatArray) -> FloatArray:
    """Asphalt with wear, repaired rectangles and drain covers."""
    shade = surface.weathered(s, t, 0.17, 0.13, 0.10)
    i, j = np.floor(s / 5.3), np.floor(t / 4.1)
    width, depth = 1 + 4 * surface.tile(i, j + 3), 0.8 + 2 * surface.tile(i, j + 5)
    patch = (surface.tile(i, j) < 0.22) & (s - 5.3 * i < width) & (t - 4.1 * j < depth)
    shade *= np.where(patch, 0.62, 1.0)
    i, j = np.floor(s / 9), np.floor(t / 9)
    u, v = s - 9 * (i + surface.tile(i, j + 8)), t - 9 * (j + surface.tile(i, j + 15))
    shade *= np.where(np.hypot(u, v) < 0.36, 0.4, 1.0)
    return tinted((0.115, 0.115, 0.118), shade)


def markings(to_x: FloatArray, to_y: FloatArray, s: FloatArray, t: FloatArray) -> NDArray[np.bool_]:
    """Where the road is painted: dashed centre lines, edge lines, crossings before the junctions."""
    painted = np.zeros(s.shape, dtype=bool)
    for across, along, position in ((to_x, np.abs(to_y), t), (to_y, np.abs(to_x), s)):
        clear = (np.abs(across) < HALF_ROAD) & (along > 9.5)
        painted |= clear & (np.abs(across) < 0.10) & (position % 5.0 < 2.6)
        painted |= clear & (np.abs(np.abs(across) - 3.25) < 0.07)
        zebra = (along > 5.6) & (along < 8.4) & (np.abs(across) < 3.2)
        painted |= zebra & ((across + 3.2) % 1.0 < 0.5)
        painted |= (np.abs(along - 9.0) < 0.2) & (across * np.sign(to_x * to_y) < 0) & (np.abs(across) < 3.2)
    return painted
