"""Covariance of the planes of footprints: noise of the depth, motion, focal length, relief, and unmatched ground.

Noise, relief and unmatched ground are variances of the gradient of ln w over a footprint, w being inverse depth, per
normalised coordinate. About a ray x, N = w (g, 1 - g.x) is the scaled normal of a plane with gradient g.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np

from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous, rotation_from_vector
from slopecli.geometry.motion import inverse_depth
from slopecli.ground.footprint_planes import FootprintPlanes
from slopecli.ground.footprints import COARSE, disc_sums
from slopecli.look.dense_depth import DEPTH, DenseDepth
from slopecli.types import BoolArray, Camera, FloatArray, Solution


@dataclass(frozen=True)
class TiltTunables:
    """Tunables of the uncertainty of planes of footprints; they are fitted to rendered ground with known depth."""

    noise: float = 0.85  # error of a plane by noise over that measured by ramps across the epipolar lines
    edge_px: float = 51.84  # of edges of relief, see `edge_variance`: 0.9^2 in footprints of 64 px
    unmatched: float = 3.0  # 1-sigma of ground that is not matched, in the relief of its footprint
    neighbours: float = 1.5  # footprints, sigma of the Gaussian over which the variance of noise is averaged
    # height of a step, of the footprint's diameter, from which on a slope across it has no meaning
    step_share: float = 0.25
    step_length: float = 0.15  # pixels on it, of the footprint's diameter
    step_off_px: int = 6  # grid px by which matching misplaces a step, towards the ground below it
    step_off_share: float = 1 / 8  # the same at most, of the footprint's diameter
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
    normals = planes.scaled_normal.reshape(-1, 1, 3)
    centre = (planes.middle[..., :2] / planes.middle[..., 2:]).reshape(-1, 1, 2)
    reach = 0.02  # normalised coordinates, of the three points that stand for a plane
    x1 = centre + reach * np.array([[1.0, 0.0], [-0.5, 0.866], [-0.5, -0.866]])
    rays = homogeneous(x1.reshape(-1, 2))
    w = (rays.reshape(-1, 3, 3) * normals).sum(-1).reshape(-1)
    moved = rays @ root.R.T - w[:, None] * (root.R @ root.T)
    x2 = moved[:, :2] / moved[:, 2:]
    seen1, seen2 = root.zoomed(0, rays[:, :2], zoom), root.zoomed(1, x2, zoom)
    other, _ = inverse_depth(R, T, seen1, seen2)
    return np.asarray(
        np.linalg.solve(homogeneous(seen1).reshape(-1, 3, 3), other.reshape(-1, 3, 1))[..., 0].reshape(
            planes.normal.shape
        )
    )


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
    """Variance of the gradient of ln w over footprints, by all but motion: by noise (rows, columns, 2, 2), and alike
    along both axes (rows, columns) by edges of relief, and by ground that is not matched, or in doubt."""

    noise: FloatArray
    edges: FloatArray
    gaps: FloatArray

    @property
    def total(self) -> FloatArray:
        """(rows, columns, 2, 2) their sum."""
        return np.asarray(self.noise + (self.edges + self.gaps)[..., None, None] * np.eye(2))


def gradient_parts(depth: DenseDepth, planes: FootprintPlanes, jump: FloatArray) -> GradientVariance:
    """Variance of the gradient of ln w by cause; jump: see `largest_jump`."""
    noise, edges = noise_variance(depth, planes), edge_variance(depth, planes)
    return GradientVariance(noise, edges, _gap_variance(depth, planes, jump))


def gradient_variance(depth: DenseDepth, planes: FootprintPlanes, jump: FloatArray) -> FloatArray:
    """(rows, columns, 2, 2) variance of the gradient of ln w by all but motion; jump: see `largest_jump`."""
    return gradient_parts(depth, planes, jump).total


def motion_gain(planes: FootprintPlanes, root: Root) -> FloatArray:
    """(rows, columns, 3, 5) change of the scaled normals of footprints by the motion that all share."""
    here, steps = planes.scaled_normal, TILT.delta * np.eye(5)
    return np.stack([(normals_under(planes, root, *root.moved(step)) - here) / TILT.delta for step in steps], -1)


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


def noise_variance(depth: DenseDepth, planes: FootprintPlanes) -> FloatArray:
    """(rows, columns, 2, 2) variance of the gradient of ln w by noise, from ramps fitted to the residual across.

    The residual across the epipolar line has no reason but noise, and the same correlation as the noise along it. What
    a ramp over a footprint is fitted to it, squared and averaged over the surroundings, is the variance sought.
    """
    error = np.where(depth.known, np.clip(depth.across_px, -1.0, 1.0) / depth.shift_px, 0.0)
    x, y = depth.rays[..., 0], depth.rays[..., 1]
    n, total, by_x, by_y = disc_sums((depth.known, error, error * x, error * y), planes.cells, COARSE)
    middle = planes.middle[..., :2] / planes.middle[..., 2:]
    # the ramp of a disc: its second moment about either axis is a fourth of its squared radius
    moment = np.maximum(n, 1.0) * (planes.cells.radius_px / depth.focal_px) ** 2 / 4.0
    ramp = np.stack([by_x - total * middle[..., 0], by_y - total * middle[..., 1]], -1) / moment[..., None]
    answered = planes.answered[..., None]
    products = np.where(answered, ramp[..., [0, 0, 1]] * ramp[..., [0, 1, 1]], 0.0)
    cells = planes.cells
    spacing = float(np.diff(cells.u).mean()) if len(cells.u) > 1 else 1.0
    sigma = TILT.neighbours * 2 * cells.radius_px / spacing
    stack = np.dstack([products, answered]).astype(np.float32)
    smooth = cv2.GaussianBlur(stack, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT).astype(float)
    a, b, c = np.moveaxis(smooth[..., :3] / np.maximum(smooth[..., 3:], 1e-9), -1, 0)
    return TILT.noise**2 * np.stack([a, b, b, c], -1).reshape(*cells.shape, 2, 2)


def edge_variance(depth: DenseDepth, planes: FootprintPlanes) -> FloatArray:
    """(rows, columns) variance of the gradient of ln w by edges of relief, each of which is misplaced at random.

    It is measured, not derived: in proportion to the mean square of the jumps over a footprint, as their errors are
    independent, and for one and the same ground to the fourth power of the diameter.
    """
    span = depth.span
    layers = (depth.known, span * depth.known, span * span * depth.known)
    n, first, second = disc_sums(layers, planes.cells, COARSE)
    n, rise = np.maximum(n, 1.0), rise_of(planes, depth)
    jumps = np.maximum(second / n - 2 * rise * first / n + rise**2, 0.0)
    return np.asarray(TILT.edge_px * jumps * depth.focal_px**2 / (2 * planes.cells.radius_px) ** 4)


def _gap_variance(depth: DenseDepth, planes: FootprintPlanes, jump: FloatArray) -> FloatArray:
    """(rows, columns) variance of the gradient of ln w by ground that is not matched, or in doubt.

    It may lie as far off the plane as the relief, or as the largest jump nearby.
    """
    relief = planes.relief / planes.middle[..., 2]
    lever = (1.0 - planes.sure) * depth.focal_px / (2 * planes.cells.radius_px)
    return np.asarray(lever**2 * ((TILT.unmatched * relief) ** 2 + jump**2))


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
    """(rows, columns) whether a footprint lies across a step, rather than on ground that is steep or rough."""
    diameter = 2 * planes.cells.radius_px
    off_px = min(TILT.step_off_px, TILT.step_off_share * diameter)
    wider = replace(planes.cells, radius_px=planes.cells.radius_px + off_px)
    pixels = disc_sums((depth.step,), wider, COARSE)[0]
    high = jump > TILT.step_share * diameter / depth.focal_px
    return np.asarray(high & (pixels > TILT.step_length * diameter))


def beside_bare(depth: DenseDepth, planes: FootprintPlanes) -> BoolArray:
    """(rows, columns) whether a footprint reaches onto ground without texture, which may be a drop.

    Or nearly so: where the window of the alignment, which reaches four of its sigmas, still has an edge beside the
    bare ground, that has the depth of the edge.
    """
    wider = replace(planes.cells, radius_px=planes.cells.radius_px + 4.0 * DEPTH.window_px)
    pixels = disc_sums((depth.bare,), wider)[0]
    return np.asarray(pixels > TILT.step_length * 2 * planes.cells.radius_px)
