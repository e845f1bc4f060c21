"""Planes of blank components, such as walls without texture: of the orientations known in the pair, with swept depth.

Too faint to match cell by cell, a blank component is compared with image 2 as a whole: all its pixels and the edges
around it, on raw grey values, as shading is the texture of a bare wall. Walls of a town, and of a room, have few
orientations, and textured ones tell them; only the depth is unknown then. The spread of the orientations that fit about
as well is the sigma.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.epipolar import normal_angle
from slopecli.geometry.statistics import robust_sigma
from slopecli.look.features import Grey
from slopecli.look.gradient_components import Labels
from slopecli.look.noise import ROUNDING_GREY
from slopecli.look.photometric import Bundle, View
from slopecli.look.scene import Scene
from slopecli.look.transfer_error import TRUNCATED_COST
from slopecli.look.warp import FloatImage, sample_grey
from slopecli.patches.regions.block_labels import enlarged
from slopecli.patches.regions.cell_lattice import CellLattice
from slopecli.patches.regions.plane_pieces import KnownTilt, Piece, tilt_sigma_rad
from slopecli.patches.regions.plane_seeds import component_of_middles
from slopecli.patches.regions.region_tunables import REGION
from slopecli.patches.windows.raw_grey import KNOWN, fitted_exposure, swept_depths, tilted_aside
from slopecli.types import BoolArray, FloatArray, IntArray


class BlankTunables(NamedTuple):
    """Which components are compared, at how many points, and how well planes must fit."""

    points: tuple[int, int, int] = (150, 800, 2000)  # of a component: over all depths, at the best, and for texture
    smooth_px: float = 0.8  # sigma of the Gaussian that takes away the noise of single pixels
    clear: float = 4.0  # standard errors of the correlation of fine texture that chance reaches once in 30 000 times
    # relative growth of the squared difference by which an orientation gets e times less likely: rendered walls grow by
    # 0.2 to 2 to the next orientation, photographed ones by 0.1 either way
    alike: float = 0.05
    sure: float = 0.9  # probability of the orientation, without which it is open


BLANK = BlankTunables()


class _Greys:
    """Grey values of both images, smoothed, under one gain and offset and with the noise of matched cells."""

    def __init__(self, view: View, scene: Scene) -> None:
        self._view, self._layer = view, view.pyramid2.at(1.0 / view.grid.mean_scale)
        self._epipole = view.R @ view.T
        self.first, self._second = (_smooth(grey, BLANK.smooth_px) for grey in (view.grid.grey, self._layer.grey))
        # beyond half a cell texture is shading, which depends on the viewpoint
        self.first_fine, self._second_fine = (
            grey - _smooth(grey, REGION.cell_px / 2) for grey in (self.first, self._second)
        )
        evidence = scene.evidence
        first = sample_grey(self.first, view.grid.inside(evidence.uv1))
        second = sample_grey(self._second, (evidence.uv2 + 0.5) * self._layer.scale - 0.5)
        self._gain, self._offset, kept = fitted_exposure(first, second)
        self.noise = robust_sigma((first - self._gain * second - self._offset)[kept], ROUNDING_GREY)

    def misfit(self, planes: FloatArray, points: Bundle, grey: FloatArray) -> FloatArray:
        """Return the mean squared difference (k,), in that of matched cells, of points (n,) on planes (k, 3)."""
        second, seen = self._pulled(self._second, planes, points)
        off = ((self._gain * second + self._offset - grey) / self.noise) ** 2
        total = np.where(seen, np.minimum(off, TRUNCATED_COST), 0.0).sum(1) / np.maximum(seen.sum(1), 1)
        return np.where(seen.mean(1) >= KNOWN.least_seen, total, np.inf)

    def correlation(self, planes: FloatArray, points: Bundle, fine: FloatArray) -> FloatArray:
        """Return the correlation (k,) of the fine texture (n,) of points with that of image 2 on planes (k, 3)."""
        second, seen = self._pulled(self._second_fine, planes, points)
        second = np.where(seen, second, 0.0)
        return np.asarray(second @ fine / np.sqrt((second**2).sum(1) * (fine @ fine) + 1e-9))

    def _pulled(self, image: FloatImage, planes: FloatArray, points: Bundle) -> tuple[FloatArray, BoolArray]:
        """Return values (k, n) of an image over image 2 at points (n,) on planes (k, 3), and whether it shows them."""
        w = planes @ points.rays.T
        x, y, z = (points.turned[:, k] - w * self._epipole[k] for k in range(3))
        ahead = (w > 0) & (z > 1e-6)
        z = np.where(ahead, z, 1.0)
        x2 = np.stack([x / z, y / z], -1)
        at = (self._view.pixels2(x2.reshape(-1, 2)).reshape(x2.shape) + 0.5) * self._layer.scale - 0.5
        beyond = 1e6  # a value that no image holds
        values = cv2.remap(
            image, at.astype(np.float32), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=beyond
        )  # type: ignore[call-overload]
        return np.asarray(values, float), ahead & (values < 1e-3 * beyond)


class _Evidence:
    """What tells the plane of a component: grey values at some or many of its points, and the few matched cells."""

    def __init__(self, mask: BoolArray, cells: BoolArray, lattice: CellLattice, greys: _Greys, view: View) -> None:
        x, y, w, h = cv2.boundingRect(mask.astype(np.uint8))
        margin = REGION.cell_px
        box = slice(max(0, y - margin), y + h + margin), slice(max(0, x - margin), x + w + margin)
        corner = np.array([box[1].start, box[0].start])
        own, side = mask[box].astype(np.uint8), REGION.cell_px
        inner = np.asarray(cv2.erode(own, np.ones((2 * side + 1, 2 * side + 1), np.uint8), borderValue=0), np.uint8)
        self._inner = _points(inner, corner, BLANK.points[2], greys.first_fine, view)
        self.fine_grey = float(self._inner[1].std()) if inner.any() else 0.0
        wide = np.asarray(cv2.dilate(own, np.ones((side + 1, side + 1), np.uint8)), np.uint8)
        self._few, self._many = (_points(wide, corner, number, greys.first, view) for number in BLANK.points[:2])
        self._independent = min(0.5 * len(self._inner[1]), float(inner.sum()) / (4.0 * np.pi * BLANK.smooth_px**2))
        self._greys, self._lattice = greys, lattice
        self._rows, self._target = lattice.rows[cells].astype(float), lattice.target[cells].astype(float)
        self.middle = np.asarray(self._many[0].rays.mean(0))
        self.contrast = float(np.var(self._many[1])) / greys.noise**2

    def misfit(self, planes: FloatArray, many: bool) -> FloatArray:
        """Return the mean squared difference (k,) of grey values on planes (k, 3), in that of matched cells."""
        return self._greys.misfit(planes, *(self._many if many else self._few))

    def unlikely(self, planes: FloatArray, misfit: FloatArray) -> FloatArray:
        """Return the negative logarithms (k,) of the likelihoods of planes (k, 3) of these misfits."""
        least = float(misfit.min())
        if not np.isfinite(least):
            return misfit
        off = np.abs(planes @ self._rows.T - self._target)
        cost = 0.5 * self._lattice.cost(off, 1.0).sum(1) / self._lattice.sharing
        return np.asarray((misfit - least) / (BLANK.alike * least) + cost)

    def texture(self, planes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the logarithms (k,) of the likelihoods of planes (k, 3) by fine texture inside, and its correlation
        in standard errors."""
        alike = np.clip(self._greys.correlation(planes, *self._inner), 0.0, 0.999)
        return -0.5 * self._independent * np.log(1.0 - alike**2), alike * np.sqrt(self._independent)

    def swept(self, units: FloatArray, depths: FloatArray, many: bool) -> tuple[FloatArray, FloatArray]:
        """Return planes (k, 3) of units (k, 3), which have 1 on the middle ray, at the best of their inverse depths
        (k, n); and the misfit (k,) of each."""
        tried = (depths[..., None] * units[:, None, :]).reshape(-1, 3)
        misfit = self.misfit(tried, many)
        unlikely = self.unlikely(tried, misfit) - (self.texture(tried)[0] if many else 0.0)
        at = unlikely.reshape(depths.shape).argmin(1)
        at += np.arange(len(units)) * depths.shape[1]
        return tried[at], misfit[at]


def find_blank_planes(
    cells: Labels,
    components: Labels,
    pieces: Sequence[Piece],
    lattice: CellLattice,
    view: View,
    scene: Scene,
    least: float,
) -> list[KnownTilt]:
    """Return the planes of the components (h, w) working px that no piece explains, the largest component first.

    cells : the labels (h, w) of cells, 0 for none.  least : px of the smallest component that is compared.
    """
    at = component_of_middles(components, lattice.shape)
    count, bare = (np.bincount(labels.ravel(), minlength=components.max() + 1) for labels in (at, at[cells == 0]))
    normals, sigmas = _known(pieces, lattice)
    if not len(normals):
        return []
    greys, depths = _Greys(view, scene), swept_depths(view, scene)

    def plane_of(mask: BoolArray, own: BoolArray) -> KnownTilt | None:
        """The plane of a part of the components, on the cells `own`, if the images tell one."""
        evidence = _Evidence(mask, own & lattice.known, lattice, greys, view)
        best = _best(evidence, normals, sigmas, depths)
        return None if best is None else KnownTilt(Piece(best[0], 1.0, own & (cells == 0)), best[1])

    mostly_bare = [k for k in _numbers(components, least) if 2 * bare[k] > count[k]]
    whole = {k: plane for k in mostly_bare if (plane := plane_of(components == k, at == k)) is not None}
    parts = _bare_parts(np.where(np.isin(components, list(whole)), 0, components), cells)
    at = component_of_middles(parts, lattice.shape)
    found = (plane_of(parts == k, at == k) for k in _numbers(parts, least))
    return [*whole.values(), *(plane for plane in found if plane is not None)]


def _numbers(labels: Labels, least: float) -> IntArray:
    """Return the labels 1, 2, ... of at least so many pixels."""
    return np.flatnonzero(np.bincount(labels.ravel())[1:] >= least) + 1


def _bare_parts(components: Labels, cells: Labels) -> Labels:
    """Return the connected parts (h, w), from 1, of components (h, w) that no cell (h, w) explains.

    A component may flow over from a blank wall to ground that has a plane. Those that nothing explains are left out.
    """
    explained = enlarged((cells > 0).astype(np.int32), REGION.cell_px, components.shape) > 0
    partly = np.isin(components, np.unique(components[explained])) & (components > 0)
    return np.asarray(cv2.connectedComponents((partly & ~explained).astype(np.uint8), connectivity=4)[1])


def _known(pieces: Sequence[Piece], lattice: CellLattice) -> tuple[FloatArray, FloatArray]:
    """Return the distinct orientations (k, 3) of pieces, unit normals, and the 1-sigma (k,) of each, rad."""
    found = [(tilt_sigma_rad(lattice, piece), piece.plane / np.linalg.norm(piece.plane)) for piece in pieces]
    found.sort(key=lambda one: one[0])
    distinct = list[tuple[float, FloatArray]]()
    for sigma, normal in found:
        apart = normal_angle(normal, np.array([other for _, other in distinct])).min() if distinct else np.pi
        if sigma < KNOWN.sure_rad and apart > 0.5 * KNOWN.sure_rad + 3.0 * sigma and len(distinct) < KNOWN.most_known:
            distinct.append((sigma, normal))
    return np.array([normal for _, normal in distinct]).reshape(-1, 3), np.array([sigma for sigma, _ in distinct])


def _best(
    evidence: _Evidence, normals: FloatArray, sigmas: FloatArray, depths: FloatArray
) -> tuple[FloatArray, float] | None:
    """Return the plane (3,) of a component with the 1-sigma of its tilt; None if none fits, or its tilt is open."""
    facing = normals @ evidence.middle
    normals, sigmas, facing = (values[np.abs(facing) > 0.05] for values in (normals, sigmas, facing))
    if not len(normals) or evidence.fine_grey < ROUNDING_GREY:
        return None
    units = normals / facing[:, None]
    coarse, misfit = evidence.swept(units, np.broadcast_to(depths, (len(units), len(depths))), many=False)
    if not np.isfinite(misfit).any():  # image 2 does not show the component
        return None
    # if more of them fit alike, the orientation is open: these show it as well as all
    start = np.argsort(evidence.unlikely(coarse, misfit), kind="stable")[: KNOWN.starts]
    units, sigmas, coarse = units[start], sigmas[start], coarse[start]
    around = np.linspace(-1.0, 1.0, 9) * (depths[1] - depths[0])
    planes, misfit = evidence.swept(units, (coarse @ evidence.middle)[:, None] + around, many=True)
    if not misfit.min() < min(REGION.unexplained, evidence.contrast + 1.0):
        return None
    best = int(evidence.unlikely(planes, misfit).argmin())
    tilted = tilted_aside(planes[best])
    tilted /= (tilted @ evidence.middle)[:, None]
    near = planes[best] @ evidence.middle + np.broadcast_to(3.0 * around, (len(tilted), len(around)))
    tilted, others = evidence.swept(tilted, near, many=True)
    every = np.vstack([planes, tilted])
    likely, clear = evidence.texture(every)
    unlikely = evidence.unlikely(every, np.append(misfit, others)) - likely
    best = int(unlikely[: len(planes)].argmin())
    if clear[best] < BLANK.clear:
        return None
    share = (1.0 - KNOWN.unknown) / len(planes), KNOWN.unknown / len(tilted)
    chance = np.repeat(share, (len(planes), len(tilted))) * np.exp(unlikely.min() - unlikely)
    chance /= chance.sum()
    apart = normal_angle(planes[best], every)
    near_by = apart < 2.5 * KNOWN.parallel_rad
    sigma = float(np.sqrt(chance[near_by] @ apart[near_by] ** 2 + sigmas[best] ** 2))
    sure = chance[near_by].sum() > BLANK.sure and sigma < KNOWN.parallel_rad
    return (planes[best], sigma) if sure else None


def _smooth(grey: Grey | FloatImage, sigma_px: float) -> FloatImage:
    return np.asarray(cv2.GaussianBlur(np.asarray(grey, np.float32), (0, 0), sigma_px), np.float32)


def _points(
    mask: NDArray[np.uint8], corner: IntArray, number: int, values: FloatImage, view: View
) -> tuple[Bundle, FloatArray]:
    """Return the rays of about so many pixels of a mask (h, w) at a corner (x, y), and the values (n,) of an image."""
    y, x = np.nonzero(mask)
    x, y = x + corner[0], y + corner[1]
    step = max(1, len(x) // number)
    y, x = y[step // 2 :: step], x[step // 2 :: step]
    return view.bundle(view.grid.full(np.stack([x, y], -1).astype(float))), np.asarray(values[y, x], float)
