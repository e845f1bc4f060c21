"""Covariance of the planes of footprints: noise of the depth, motion, focal length, relief, and unmatched ground.

Noise, relief and unmatched ground are variances of the gradient of ln w over a footprint, w being inverse depth, per
normalised coordinate. About a ray x, N = w (g, 1 - g.x) is the scaled normal of a plane with gradient g.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np

from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous, rotation_from_vector
from slopecli.geometry.motion import inverse_depth
from slopecli.ground.footprint_planes import LEAST_SHARE, FootprintPlanes
from slopecli.ground.footprints import COARSE, Cells, disc_area, disc_sums
from slopecli.look.dense_depth import DEPTH, DenseDepth
from slopecli.look.warp import FloatImage, gaussian_reach
from slopecli.types import BoolArray, Camera, FloatArray, Solution


class TiltTunables(NamedTuple):
    """Tunables of the uncertainty of planes of footprints; they are fitted to rendered ground with known depth."""

    ramp_px: float = 16.0  # grid px, radius of the discs on which `shared_px` is measured
    edge_alike_px: float = 2.0  # grid px that share an error as large as a jump of depth
    # height of a step, of the footprint's diameter, from which on a slope across it has no meaning
    step_share: float = 0.25
    step_length: float = 0.15  # pixels on it, of the footprint's diameter
    step_off_px: int = 6  # grid px by which matching misplaces a step, towards the ground below it
    step_off_share: float = 1 / 8  # the same at most, of the side of a small window
    cause_cells: int = 2500  # that the causes of the sigma are a mean of; more take time only
    delta: float = 1e-4  # rad and relative, of numerical derivatives


TILT = TiltTunables()


@dataclass(frozen=True, eq=False)
class Root:
    """A motion that the depth was measured with, or another that explains the images as well.

    R, T : as in `Solution`.  covariance : (5, 5) of the motion without the focal length's part.
    tangent : (3, 2) basis of T's last two coordinates.
    focal_sigma : of the focal length's logarithm; focal_motion (5,): change of the motion that goes with it.
    cameras : whose lenses bend rays by another share where the focal length is another; None for pinholes.
    """

    R: FloatArray
    T: FloatArray
    covariance: FloatArray
    tangent: FloatArray
    focal_sigma: float
    focal_motion: FloatArray
    cameras: tuple[Camera, Camera] | None = None

    @classmethod
    def of(cls, solution: Solution, focal_sigma: float, cameras: tuple[Camera, Camera]) -> Root:
        """The motion of a solution, solved with a focal length of this relative sigma."""
        motion = np.zeros(5) if solution.focal_shift is None else solution.focal_shift[-5:]
        covariance = solution.motion_covariance - np.outer(motion, motion)
        return cls(solution.R, solution.T, covariance, solution.tangent, focal_sigma, motion, cameras)

    def zoomed(self, number: int, x: FloatArray, zoom: float) -> FloatArray:
        """Coordinates (n, 2) of the same pixels of camera 0 or 1 seen with a focal length that is 1 / zoom as long."""
        if zoom == 1.0 or self.cameras is None:
            return x * zoom
        camera = self.cameras[number]
        again = replace(camera, fx=camera.fx / zoom, fy=camera.fy / zoom)
        seen = rays_from_pixels(again, pixels_from_rays(camera, x))
        return np.where(np.isfinite(seen), seen, x * zoom)

    def moved(self, step: FloatArray) -> tuple[FloatArray, FloatArray]:
        """R and T after a step (5,) of the motion."""
        T = self.T + self.tangent @ step[3:]
        return rotation_from_vector(step[:3]) @ self.R, T / np.linalg.norm(T)


def normals_under(planes: FootprintPlanes, root: Root, R: FloatArray, T: FloatArray, zoom: float = 1.0) -> FloatArray:
    """(rows, columns, 3) scaled normals of footprints if another motion explains what the images show.

    planes : measured with the motion `root`.  zoom : of both images, see `Root.zoomed`.
    """
    return _normals_under_each(planes, root, [(R, T)], zoom)[..., 0]


def _normals_under_each(
    planes: FootprintPlanes, root: Root, motions: Sequence[tuple[FloatArray, FloatArray]], zoom: float = 1.0
) -> FloatArray:
    """(rows, columns, 3, k) scaled normals of footprints under each of k motions R, T."""
    normals = planes.scaled_normal.reshape(-1, 1, 3)
    centre = (planes.middle[..., :2] / planes.middle[..., 2:]).reshape(-1, 1, 2)
    reach = 0.02  # normalised coordinates, of the three points that stand for a plane: any small triangle gives it
    x1 = centre + reach * np.array([[1.0, 0.0], [-0.5, 0.866], [-0.5, -0.866]])
    rays = homogeneous(x1.reshape(-1, 2))
    w = (rays.reshape(-1, 3, 3) * normals).sum(-1).reshape(-1)
    moved = rays @ root.R.T - w[:, None] * (root.R @ root.T)
    x2 = moved[:, :2] / moved[:, 2:]
    seen1, seen2 = root.zoomed(0, rays[:, :2], zoom), root.zoomed(1, x2, zoom)
    others = np.stack([inverse_depth(R, T, seen1, seen2)[0].reshape(-1, 3) for R, T in motions], -1)
    found = np.linalg.solve(homogeneous(seen1).reshape(-1, 3, 3), others)
    return np.asarray(found.reshape(*planes.normal.shape, len(motions)))


def normal_covariance(planes: FootprintPlanes, root: Root, gradient: FloatArray) -> FloatArray:
    """(rows, columns, 3, 3) covariance of the scaled normals of footprints.

    gradient : (rows, columns, 2, 2) variance of the gradient of ln w; motion and focal length are added.
    """
    spread = normal_spread(planes)
    return np.asarray(spread @ gradient @ spread.swapaxes(-1, -2) + _motion_covariance(planes, root))


def normal_spread(planes: FootprintPlanes) -> FloatArray:
    """(rows, columns, 3, 2) derivatives of the scaled normals by the gradient of ln w."""
    x = planes.middle[..., :2] / planes.middle[..., 2:]
    spread = np.zeros((*x.shape[:2], 3, 2))
    spread[..., 0, 0] = spread[..., 1, 1] = 1.0
    spread[..., 2, :] = -x
    return np.asarray(spread / planes.middle[..., 2, None, None])


class GradientVariance(NamedTuple):
    """Variance of the gradient of ln w over footprints (rows, columns), alike along both axes, by all but motion: by
    errors of matches, by edges of relief, and by ground that is not matched, or in doubt."""

    noise: FloatArray
    edges: FloatArray
    gaps: FloatArray

    @property
    def total(self) -> FloatArray:
        """(rows, columns, 2, 2) their sum."""
        return np.asarray((self.noise + self.edges + self.gaps)[..., None, None] * np.eye(2))


def gradient_parts(depth: DenseDepth, planes: FootprintPlanes, jump: FloatArray) -> GradientVariance:
    """Variance of the gradient of ln w by cause.

    jump (rows, columns) : of ln w at the step that a footprint lies across, 0 without a step.
    """
    sums = disc_sums(error_layers(depth)[:4], planes.cells, COARSE)
    # the second moment of a disc about either axis is a fourth of its squared radius
    moment = np.maximum(sums[0], 1.0) * (planes.cells.radius_px / depth.focal_px) ** 2 / 4.0
    noise, edges = (density / moment for density in error_densities(sums, rise_of(planes, depth)))
    return GradientVariance(noise, edges, _gap_variance(depth, planes, jump))


def motion_gain(planes: FootprintPlanes, root: Root) -> FloatArray:
    """(rows, columns, 3, 5) change of the scaled normals of footprints by the motion that all share."""
    moved = _normals_under_each(planes, root, [root.moved(step) for step in TILT.delta * np.eye(5)])
    return (moved - planes.scaled_normal[..., None]) / TILT.delta


def focal_shift(planes: FootprintPlanes, root: Root) -> FloatArray:
    """(rows, columns, 3) change of the scaled normals of footprints by 1-sigma of the focal length."""
    if not root.focal_sigma:
        return np.zeros_like(planes.normal)
    small = TILT.delta / root.focal_sigma
    moved = root.moved(small * root.focal_motion)
    return (normals_under(planes, root, *moved, zoom=float(np.exp(-TILT.delta))) - planes.scaled_normal) / small


def _motion_covariance(planes: FootprintPlanes, root: Root) -> FloatArray:
    """(rows, columns, 3, 3) of the scaled normals, by the motion and by the focal length."""
    gain, shift = motion_gain(planes, root), focal_shift(planes, root)
    return np.asarray(gain @ root.covariance @ gain.swapaxes(-1, -2) + shift[..., :, None] * shift[..., None, :])


def error_layers(depth: DenseDepth) -> list[FloatImage]:
    """Layers (h, w) whose sums `error_densities` takes: pixels known, and of these the variance of ln w times the
    pixels that share an error, and the jumps of ln w beside them, and their squares. The fifth is the second for an
    error of 1 grid px.
    """
    known = depth.known.astype(np.float32)
    of_one_px = np.float32(shared_px(depth)) * known / depth.shift_px**2
    span = depth.span * known
    return [known, of_one_px * np.clip(depth.along_px, -1.0, 1.0) ** 2, span, span * span, of_one_px]


def shared_px(depth: DenseDepth) -> float:
    """Number of pixels that share an error of matching, as large as what alignment left along the epipolar lines.

    Ramps fitted over discs to the residual across the lines, which has no other reason but noise and the same
    correlation, are that many times larger in square than independent errors would make them.
    """
    rows, columns = depth.w.shape
    u, v = np.arange(columns, dtype=np.float32), np.arange(rows, dtype=np.float32)[:, None]
    radius, known = TILT.ramp_px, depth.known
    places = [np.arange(int(radius), count, int(radius)) for count in (columns, rows)]
    cells = Cells(places[0], places[1], radius)
    across = np.where(known, np.clip(depth.across_px, -1.0, 1.0), np.float32(0.0))
    left2 = np.where(known, np.clip(depth.along_px, -1.0, 1.0) ** 2, np.float32(0.0))
    n, total, by_u, by_v, left2 = disc_sums((known, across, across * u, across * v, left2), cells)
    ramps = (by_u - total * cells.u) ** 2 + (by_v - total * cells.v[:, None]) ** 2
    whole = n >= LEAST_SHARE * disc_area(radius)
    if not whole.any():
        return 4.0 * np.pi * DEPTH.window_px**2
    # the second moment of a disc is half its squared radius; ramps have an exponential distribution, of median ln 2
    ratio = ramps[whole] / np.maximum(0.5 * radius**2 * left2[whole], np.finfo(np.float32).tiny)
    return float(np.median(ratio) / np.log(2.0))


def error_densities(sums: Sequence[FloatArray], rise: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variance of ln w times the pixels that share an error, by errors of matches, and by edges of relief.

    The former follow from what is left along the epipolar lines: a smaller window than that of the alignment still asks
    for a displacement where noise, a border, relief or a mismatch misled the larger one. Edges are each misplaced at
    random, so that errors are in proportion to the jumps.

    sums : of `error_layers` over footprints or windows.  rise : `DenseDepth.span` on the plane, see `rise_of`.
    """
    known, matches, first, second = sums
    n = np.maximum(known, 1.0)
    jumps2 = np.maximum(second / n - 2 * rise * first / n + rise**2, 0.0)
    return matches / n, TILT.edge_alike_px * jumps2


def _gap_variance(depth: DenseDepth, planes: FootprintPlanes, jump: FloatArray) -> FloatArray:
    """(rows, columns) variance of the gradient of ln w by ground that is not matched, or in doubt.

    All of it together may lie off the plane by as much as the relief of its footprint; what lies around the middle on
    all sides tilts nothing. Across a step it may lie on the other side of the jump.
    """
    cells, radius = planes.cells, planes.cells.radius_px
    rows, columns = depth.w.shape
    u, v = np.arange(columns, dtype=np.float32), np.arange(rows, dtype=np.float32)[:, None]
    n, by_u, by_v = disc_sums((depth.sure, depth.sure * u, depth.sure * v), cells)
    # a whole disc has its centre in its middle, so that the rest is as far off to one side as these are to the other
    moment2 = (by_u - n * cells.u) ** 2 + (by_v - n * cells.v[:, None]) ** 2
    # the second moment of a disc about either axis is a fourth of its squared radius
    lever2 = moment2 * (4.0 * depth.focal_px / (disc_area(radius) * radius**2)) ** 2 / 2.0
    at_step = (1.0 - planes.sure) * depth.focal_px / (2.0 * radius) * jump
    return np.asarray(lever2 * (planes.relief / planes.middle[..., 2]) ** 2 + at_step**2)


def rise_of(planes: FootprintPlanes, depth: DenseDepth) -> FloatArray:
    """(rows, columns) `DenseDepth.span` on the plane of a footprint."""
    rise = np.abs(planes.scaled_normal[..., :2]).sum(-1) * planes.middle[..., 2]
    return np.asarray(rise * (DEPTH.side_px - 1) / depth.focal_px)


def largest_jump(depth: DenseDepth, planes: FootprintPlanes) -> FloatArray:
    """(rows, columns) largest jump of ln w between neighbouring pixels in a footprint and around it.

    As far as twice the distance by which matching misplaces a step. What the footprint's plane rises by is subtracted.
    """
    cells, span, side = planes.cells, depth.span, DEPTH.side_px - 1
    rows, columns = (n // side for n in span.shape)
    blocks = span[: rows * side, : columns * side].reshape(rows, side, columns, side).max((1, 3))
    reach = int(np.ceil((cells.radius_px + 2 * TILT.step_off_px) / side))
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    largest = cv2.dilate(blocks, disc)
    at = np.ix_(np.minimum(cells.v // side, rows - 1), np.minimum(cells.u // side, columns - 1))
    return np.maximum(largest[at] - rise_of(planes, depth), 0.0)


def across_step(depth: DenseDepth, planes: FootprintPlanes, jump: FloatArray) -> BoolArray:
    """(rows, columns) whether a footprint lies across a step, rather than on ground that is steep or rough.

    Or so near one, on its upper side, that it may: matching misplaces a step towards the ground below it.
    """
    diameter = 2 * planes.cells.radius_px
    wider = replace(planes.cells, radius_px=planes.cells.radius_px + TILT.step_off_px)
    height = TILT.step_share * diameter / depth.focal_px
    # where depth makes little displacement a step makes little of it, too: its height tells, over squares of `side_px`
    high = (depth.span > height) & depth.known
    step = np.maximum(depth.step, high.astype(np.float32) / DEPTH.side_px)
    near, sums = disc_sums((depth.step, depth.step * np.log(depth.w)), wider, COARSE)
    above = -np.log(planes.middle[..., 2]) * near > sums
    inside = disc_sums((step,), planes.cells, COARSE)[0]
    pixels = np.where(above, np.maximum(near, inside), inside)
    return np.asarray((jump > height) & (pixels > TILT.step_length * diameter))


def beside_bare(depth: DenseDepth, planes: FootprintPlanes) -> BoolArray:
    """(rows, columns) whether a footprint reaches onto ground without texture, which may be a drop.

    Or nearly so: where the window of the alignment still has an edge beside the bare ground, that has the depth of the
    edge.
    """
    wider = replace(planes.cells, radius_px=planes.cells.radius_px + gaussian_reach(DEPTH.window_px))
    pixels = disc_sums((depth.bare,), wider)[0]
    return np.asarray(pixels > TILT.step_length * 2 * planes.cells.radius_px)


def wholly_shown(shown: BoolArray, cells: Cells) -> BoolArray:
    """(rows, columns) whether image 2 shows all of a footprint, and the pixels around it that a border would mislead.

    shown : (h, w).  Beyond image 1 nothing is shown.
    """
    wider = replace(cells, radius_px=cells.radius_px + DEPTH.beside_px)
    missing = disc_area(wider.radius_px) - disc_sums((shown,), wider)[0]
    return np.asarray(missing <= TILT.step_length * 2 * cells.radius_px)
