"""Footprints of patches on a picture of image 1: windows and rejected patches from polygons, regions from pixels."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.camera import rays_from_pixels
from slopecli.look.gradient_components import boxes_of
from slopecli.products.drawing import marks
from slopecli.report.slope_units import SLOPE_UNITS, SlopeUnit, slope_unit_of
from slopecli.types import AlternativePlane, BoolArray, Camera, FloatArray, Plane, Rejected, Report

Mask = NDArray[np.uint8]


def mask_of(labels: NDArray[np.generic], label: int) -> Mask:
    """Return (h, w) uint8, 255 where the map has this id."""
    return np.multiply(labels == label, 255, dtype=np.uint8)


def inner_distance(mask: Mask) -> NDArray[np.float32]:
    """Return (h, w) distance from every pixel of a mask to the nearest one outside it, or beyond its sides, px."""
    distance = cv2.distanceTransform(np.pad(mask, 1), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(distance[1:-1, 1:-1], np.float32)


def outlines_of(mask: Mask, step: float = 1.0) -> list[FloatArray]:
    """Trace a mask (h, w): one closed outline (k, 2) px per piece, largest first, then one per hole.

    They run along the centres of the outermost pixels, with staircases straightened, whose steps are `step` px high.
    """
    contours, hierarchy = cv2.findContours(mask, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    if hierarchy is None:
        return []
    hole = hierarchy.reshape(-1, 4)[:, 3] >= 0
    tolerance = 0.7 * step  # steps of one pixel become the line they stand for
    order = sorted(range(len(contours)), key=lambda i: (bool(hole[i]), -cv2.contourArea(contours[i])))
    return [cv2.approxPolyDP(contours[i], tolerance, True).reshape(-1, 2).astype(float) for i in order]


Pixel = TypeVar("Pixel", bound=np.generic)


@dataclass(frozen=True, eq=False)
class Pieces:
    """What a patch of any shape has beyond a polygon.

    outlines : closed, (k, 2) picture px each, of all pieces and holes worth one.
    cover : (h, w) uint8, how much of a pixel the patch covers, 255 for all.
    ground : (h, w) uint8, 255 where label and arrow may lie: the largest piece, specks of no plane included.
    pole : (2,) picture px, the point of the largest piece that is farthest from its border.
    radius : greatest distance of a point from the border of the ground, px.
    """

    outlines: Sequence[FloatArray]
    cover: Mask
    ground: Mask
    pole: FloatArray
    radius: float


@dataclass(frozen=True, eq=False)
class Footprint:
    """A patch on the picture.

    polygon : (k, 2) picture px; of a patch in pieces the outline of the largest.
    mask : (h, w) uint8, 255 where the patch shows, of its bounding box, whose first pixel is `corner` (u, v).
    downhill : (2,) unit vector on the picture, None where undefined.
    other : the plane in the second answer, when the first is not known to be the right one.
    pieces : the true shape of a patch that is no polygon.
    unit : that its slope is written in.
    """

    item: Plane | Rejected
    polygon: FloatArray
    mask: Mask
    corner: tuple[int, int]
    downhill: FloatArray | None = None
    other: AlternativePlane | None = None
    pieces: Pieces | None = None
    unit: SlopeUnit = SLOPE_UNITS["deg"]

    @property
    def slope_deg(self) -> float | None:
        """Slope that it is shown with, None where none is known."""
        return self.item.slope_deg if isinstance(self.item, Plane) and self.item.slope_known else None

    @property
    def verdict(self) -> str:
        """Verdict that hatch and frame show; "level" of the plane taken so, "rejected" where the slope is not known."""
        return self.item.verdict or "level" if isinstance(self.item, Plane) and self.item.slope_known else "rejected"

    @property
    def badge(self) -> str:
        """Verdict of its badge; "unsafe" also where the slope is not known but is certainly too steep."""
        unsafe = isinstance(self.item, Plane) and self.item.verdict == "unsafe"
        return "unsafe" if unsafe else self.verdict

    @property
    def outlines(self) -> Sequence[FloatArray]:
        return [self.polygon] if self.pieces is None else self.pieces.outlines

    @property
    def ground(self) -> Mask:
        """(h, w) uint8, 255 where the label may lie."""
        return self.mask if self.pieces is None else self.pieces.ground

    @cached_property
    def centre(self) -> FloatArray:
        """(2,) where the label would best be, px: the centre of gravity, or the pole of a patch of any shape."""
        if self.pieces is not None:
            return self.pieces.pole
        moments = cv2.moments(self.mask, binaryImage=True)
        return np.array([moments["m10"], moments["m01"]]) / max(moments["m00"], 1.0) + self.corner

    @cached_property
    def size(self) -> float:
        """Side of the square of the same area as the ground, px."""
        return math.sqrt(cv2.countNonZero(self.ground))

    def crop(self, picture: NDArray[Pixel]) -> NDArray[Pixel]:
        """View of the picture under the bounding box."""
        (u, v), (height, width) = self.corner, self.mask.shape
        return picture[v : v + height, u : u + width]


def footprints_of(report: Report, scale: float, shape: tuple[int, int], text_px: int) -> list[Footprint]:
    """Find the patches that touch a picture: polygons, where of two the smaller has the ground, then planes found.

    Parameters
    ----------
    report : the finished answer.
    scale : of the picture against image 1.
    shape : height and width of the picture, px.
    text_px : size of its text; specks smaller than that neither push a label away nor get an outline.

    Returns
    -------
    Of both kinds the largest first.
    """
    regions = [plane for plane in report.planes if plane.found]
    windows = [plane for plane in report.planes if not plane.found]
    labels = np.zeros(shape, np.uint16)
    if regions:
        labels = np.asarray(cv2.resize(report.labels, shape[::-1], interpolation=cv2.INTER_NEAREST_EXACT), np.uint16)
    polygons = _largest_first(_of_polygons(report, [*windows, *report.rejected], scale, labels))
    _share_ground(polygons, shape)
    if not regions:
        return polygons
    return [*polygons, *_largest_first(_of_regions(report, regions, scale, labels, text_px))]


def downhill_px(report: Report, plane: Plane, uv: FloatArray | None = None) -> FloatArray | None:
    """Return the direction in image 1 in which the plane falls.

    Parameters
    ----------
    uv : (2,) px of image 1, where; the middle of the plane's polygon when None.

    Returns
    -------
    (2,) unit vector (right, down) in pixels, or None for a plane whose downhill direction or slope is not known.
    """
    if plane.aspect_deg is None or not plane.slope_known:
        return None
    up, normal = np.array(report.up.vector_cam1), np.asarray(plane.normal_cam1)
    fall = (up @ normal) * normal - up
    middle = np.asarray(plane.polygon_px, float).mean(axis=0) if uv is None else uv
    direction = motion_px(report.cameras[0], middle, fall)
    length = np.linalg.norm(direction)
    return direction / length if length > 0 else None  # NaN where the lens has no ray compares false too


def motion_px(camera: Camera, uv: FloatArray, vector_cam1: FloatArray) -> FloatArray:
    """Return how the image of a point moves when the point does, lens distortion included.

    Parameters
    ----------
    uv : (2,) px, image of the point.  vector_cam1 : (3,) motion of the point, in units of its depth.

    Returns
    -------
    (2,) px (right, down), to first order; NaN where the lens has no ray.
    """
    ray, *beside = rays_from_pixels(camera, uv + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    ray_by_px = (np.array(beside) - ray).T  # derivative
    return np.linalg.solve(ray_by_px, vector_cam1[:2] - ray * vector_cam1[2])


def _largest_first(footprints: Iterable[Footprint]) -> list[Footprint]:
    return sorted(footprints, key=lambda footprint: -cv2.countNonZero(footprint.mask))


def _of_polygons(
    report: Report, items: Sequence[Plane | Rejected], scale: float, labels: NDArray[np.uint16]
) -> Iterator[Footprint]:
    """Patches given by an outline, less what is labelled as a plane found."""
    others, unit = report.ambiguity.others, slope_unit_of(report.options)
    for item in items:
        polygon = (np.asarray(item.polygon_px, float) + 0.5) * scale - 0.5
        low = np.clip(np.floor(polygon.min(axis=0)).astype(int), 0, None)
        high = np.minimum(np.ceil(polygon.max(axis=0)).astype(int) + 1, labels.shape[::-1])
        if (high <= low).any():
            continue
        mask = np.zeros(tuple(high - low)[::-1], np.uint8)
        cv2.fillPoly(mask, [marks.fixed_point(polygon - low)], 255, cv2.LINE_8, marks.SHIFT)
        mask[labels[low[1] : high[1], low[0] : high[0]] > 0] = 0
        downhill = downhill_px(report, item) if isinstance(item, Plane) else None
        if mask.any():
            corner = int(low[0]), int(low[1])
            yield Footprint(item, polygon, mask, corner, downhill, others.get(item.id), unit=unit)


def _share_ground(footprints: Sequence[Footprint], shape: tuple[int, int]) -> None:
    """Take from every mask what a later footprint covers, unless nothing would be left of it."""
    owner = np.full(shape, -1, np.int32)
    for index, footprint in enumerate(footprints):
        footprint.crop(owner)[footprint.mask > 0] = index
    for index, footprint in enumerate(footprints):
        own = footprint.crop(owner) == index
        if own.any():
            footprint.mask[~own] = 0


def _of_regions(
    report: Report, planes: Sequence[Plane], scale: float, labels: NDArray[np.uint16], text_px: int
) -> Iterator[Footprint]:
    """Patches given by their pixels in the labels of the picture."""
    others, unit, boxes = report.ambiguity.others, slope_unit_of(report.options), boxes_of(labels)
    for plane in planes:
        if plane.id not in boxes:
            continue
        rows, columns = boxes[plane.id]
        corner = (columns.start, rows.start)
        mask = _smoothed(mask_of(labels[rows, columns], plane.id), scale)
        pieces = _pieces(mask, labels[rows, columns] == 0, corner, max(1.0, scale), text_px)
        downhill = downhill_px(report, plane, (pieces.pole + 0.5) / scale - 0.5)
        yield Footprint(plane, pieces.outlines[0], mask, corner, downhill, others.get(plane.id), pieces, unit)


def _smoothed(mask: Mask, scale: float) -> Mask:
    """Round the staircases of enlarged pixels."""
    if scale <= 1.0:
        return mask
    blurred = cv2.GaussianBlur(mask, (0, 0), 0.5 * scale, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(cv2.threshold(blurred, 127, 255, cv2.THRESH_BINARY)[1], np.uint8) if blurred.max() > 127 else mask


def _pieces(mask: Mask, free: BoolArray, corner: tuple[int, int], step: float, text_px: int) -> Pieces:
    """Shape of a mask (h, w) whose first pixel is `corner`; `free` (h, w) is where no plane is."""
    _, parts, stats, _ = cv2.connectedComponentsWithStats(mask)
    piece, outlines = mask_of(parts, 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))), outlines_of(mask, step)
    closing = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (text_px // 2 * 2 + 1,) * 2)
    ground = np.asarray(cv2.morphologyEx(piece, cv2.MORPH_CLOSE, closing), np.uint8)
    ground[~free & (piece == 0)] = 0
    depth = np.where(piece > 0, inner_distance(ground), np.float32(0.0))
    cover = np.zeros_like(mask)
    cv2.fillPoly(cover, [marks.fixed_point(outline) for outline in outlines], 255, cv2.LINE_AA, marks.SHIFT)
    large = [outline for outline in outlines if cv2.contourArea(outline.astype(np.float32)) >= 0.25 * text_px**2]
    outlines = [outline + corner for outline in large or outlines[:1]]
    deep = np.argwhere(depth >= 0.95 * depth.max())  # a long region is deepest all along its middle line
    pole = deep[np.argmin(((deep - deep.mean(axis=0)) ** 2).sum(axis=1)), ::-1].astype(float)
    return Pieces(outlines, cover, ground, pole + corner, float(depth.max()))
