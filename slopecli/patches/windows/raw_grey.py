"""Planes compared on raw grey values: of every orientation the depth is swept, and image 2 pulled through the plane.

Shading is all the texture that a bare wall has, and a high pass would remove it. So there is one gain for the pair, and
one offset, from which that of a window may differ somewhat.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import tangent_basis
from slopecli.geometry.statistics import median, robust_sigma
from slopecli.look.matches import LEAST_MATCHES
from slopecli.look.noise import ROUNDING_GREY
from slopecli.look.photometric import TILTS, View
from slopecli.look.scene import Scene
from slopecli.look.warp import covered, map_nodes, node_shape, sample_grey, sample_layer, spread_table
from slopecli.patches.windows.tunables import TUNE
from slopecli.types import BoolArray, FloatArray


class OrientationTunables(NamedTuple):
    """When an orientation is known, which windows are compared with it, and how well they must fit."""

    faint_score: float = 0.55  # own matches that agree less, and are in doubt, are chance as often as not
    starts: int = 3  # known orientations that a faint window is aligned from, those of the least misfit
    better: float = 0.05  # growth of the correlation by which another start is no chance
    most_known: int = 12  # orientations compared: rooms and streets have fewer
    # 1-sigma of the tilt of a plane whose orientation counts as known; those nearer than half of it are the same
    sure_rad: float = float(np.radians(3.0))
    parallel_rad: float = float(np.radians(10.0))  # orientations that shading does not tell from each other
    least_seen: float = 0.75  # share of a window that image 2 must show: planes are compared on nearly the same pixels
    alike: float = 0.02  # relative growth of the squared difference by which an orientation gets e times less likely
    unknown: float = 0.3  # probability beforehand of an orientation that is not among the known

    @property
    def untold(self) -> float:
        """Squared difference, grey levels, that tells nothing: both images are rounded, and resampled."""
        return (2.0 * ROUNDING_GREY) ** 2


KNOWN = OrientationTunables()


class Exposure(NamedTuple):
    """Grey values of image 1 are gain times those of image 2 plus offset, to a 1-sigma of noise."""

    gain: float
    offset: float
    noise: float


def exposure_of(scene: Scene) -> Exposure:
    """Gain and offset between the images, from the grey values of their matches, mismatches left out."""
    first, second = scene.evidence.grey, sample_grey(scene.pyramid2.at(1.0).grey, scene.evidence.uv2)
    gain, offset, _ = fitted_exposure(first, second)
    return Exposure(gain, offset, robust_sigma(first - gain * second - offset))


def fitted_exposure(first: FloatArray, second: FloatArray) -> tuple[float, float, BoolArray]:
    """Gain and offset that take grey values (n,) of image 2 to those of image 1, and which (n,) they were fitted to."""
    gain, offset, kept = 1.0, 0.0, np.ones(len(first), bool)
    for _ in range(4):  # settles in three
        if kept.sum() < LEAST_MATCHES or np.ptp(second[kept]) < 1.0:
            break
        gain, offset = np.polyfit(second[kept], first[kept], 1)
        residual = first - gain * second - offset
        kept = np.abs(residual) <= 3.0 * robust_sigma(residual)
    return float(gain), float(offset), kept


class Compared(NamedTuple):
    """Orientations (k, 3), scaled normals, with the least misfit (k,) over the depths, its depth, and a prior (k,)."""

    normals: FloatArray
    misfit: FloatArray
    depth: FloatArray
    prior: FloatArray

    def joined(self, other: Compared) -> Compared:
        """Both, one after the other."""
        return Compared(*(np.concatenate(pair) for pair in zip(self, other, strict=True)))

    def chance(self, variance: float) -> FloatArray:
        """(k,) probability of each, one of them being right.

        variance : of the window's grey values; differences tell less where not even the best explains it.
        """
        least, rounding = float(self.misfit.min()), ROUNDING_GREY**2
        unit = KNOWN.alike * (KNOWN.untold + least * (1.0 + least / max(variance, rounding)))
        likely = self.prior * np.exp(-(self.misfit - least) / unit)
        return np.asarray(likely / max(float(likely.sum()), 1e-300))


def open_orientations(view: View) -> FloatArray:
    """(k, 3) scaled normals of every tilt that a search for planes knows."""
    centre = view.pixels.rays.mean(0)
    return np.array([[x, y, 1.0 - x * centre[0] - y * centre[1]] for x, y in TILTS])


def swept_depths(view: View, scene: Scene) -> FloatArray:
    """(n,) inverse depths, 1/baseline, two thirds of a px of the grid apart."""
    return scene.evidence.sweep_depths(1.5 * view.grid.mean_scale, 12, 100)


def tilted_aside(normal: FloatArray) -> FloatArray:
    """(8, 3) normals tilted from this one by what shading may not tell, and by twice as much, to four sides."""
    unit = normal / np.linalg.norm(normal)
    sides = tangent_basis(unit).T
    angle = KNOWN.parallel_rad * np.array([1.0, -1.0, 2.0, -2.0])
    return np.concatenate([np.cos(angle)[:, None] * unit + np.sin(angle)[:, None] * side for side in sides])


def compared(
    view: View, normals: FloatArray, depths: FloatArray, exposure: Exposure, prior: FloatArray | float
) -> Compared:
    """Planes parallel to the normals (k, 3), each at the best of the inverse depths (n,) in the middle of the window.

    prior : (k,) of each, or one number that all share.
    """
    facing = normals / (normals @ view.pixels.rays.mean(0))[:, None]
    every = np.array([misfit(view, depths[:, None] * one, exposure) for one in facing])
    each = prior if isinstance(prior, np.ndarray) else np.full(len(normals), prior / len(normals))
    # between the depths swept, too: they are two thirds of a px apart, and shading tells tenths of one
    near = depths[every.argmin(axis=1)][:, None] + (depths[1] - depths[0]) * np.linspace(-0.5, 0.5, 5)
    finer = np.array([misfit(view, row[:, None] * one, exposure) for row, one in zip(near, facing, strict=True)])
    rows, least = np.arange(len(facing)), finer.argmin(axis=1)
    return Compared(facing, finer[rows, least], near[rows, least], each)


def misfit(view: View, planes: FloatArray, exposure: Exposure) -> FloatArray:
    """(n,) mean squared difference, grey levels, of the window and image 2 through planes (n, 3); inf where unseen."""
    nodes = view.bundle(map_nodes(view.grid))
    layer, ours = view.pyramid2.at(1.0 / view.grid.mean_scale), view.grid.grey.astype(np.float32)
    found = np.full(len(planes), np.inf)
    # a window may be brighter or darker than the pair's offset says, as lamps and lenses make it: by the noise of that
    unlikely = 0.5 * KNOWN.alike * KNOWN.untold / max(exposure.noise, ROUNDING_GREY) ** 2
    for i, plane in enumerate(planes):
        table = view.transfer(nodes, plane).reshape(*node_shape(view.grid.shape), 2)
        mapping = spread_table(table, view.grid.shape)
        seen = covered(mapping, view.shape2)
        if seen.mean() < KNOWN.least_seen:
            continue
        off = (exposure.gain * sample_layer(layer, mapping) + exposure.offset - ours)[seen]
        shift = median(off)
        found[i] = np.minimum((off - shift) ** 2, TUNE.same_grey**2).mean() + unlikely * shift**2
    return found
