"""Meshes of planes in camera-1 axes; of regions, a grid of triangles over each, cut along its border.

Pixels of image 1 are projected along their rays, lens distortion included. Source of the cut: Lorensen, Cline,
"Marching cubes", 1987, in two dimensions, on the signed distance to the border.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from weakref import WeakKeyDictionary

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.camera import points_on_plane
from slopecli.look.gradient_components import boxes_of
from slopecli.look.warp import Box
from slopecli.products.drawing.outlines import Mask, inner_distance, mask_of
from slopecli.types import BoolArray, Camera, FloatArray, IntArray, Plane, Report

MOST_TRIANGLES = 200_000  # of all regions: a file of 7 MB, a vertex for every third or fourth pixel of a megapixel
FARTHEST = 20.0  # times the scene's distance; beyond it lies what a plane's last rays before its horizon hit


@dataclass(frozen=True, eq=False)
class Surface:
    """Part of a plane: uv (n, 2) px of image 1, points (n, 3) in camera-1 axes, triangles (m, 3) of their indices."""

    plane: Plane
    uv: FloatArray
    points: FloatArray
    triangles: IntArray


def lay_on_plane(plane: Plane, camera: Camera, uv: FloatArray, triangles: IntArray) -> Surface | None:
    """Project a flat mesh in image 1, uv (n, 2) px and triangles (m, 3), onto a plane `normal_cam1 . P = -distance`.

    Returns the part that meets the plane in front of the camera and not at a grazing angle, None where nothing does.
    """
    points, met = points_on_plane(camera, uv, plane.normal_cam1, plane.distance)
    return trimmed(Surface(plane, uv, points, triangles), met)


def trimmed(surface: Surface, keep: BoolArray) -> Surface | None:
    """Return what is left with the vertices to `keep` (n,) and the triangles between them, None if nothing is."""
    used, triangles = kept_part(surface.triangles, keep)
    return Surface(surface.plane, surface.uv[used], surface.points[used], triangles) if len(triangles) else None


def kept_part(triangles: IntArray, keep: BoolArray) -> tuple[BoolArray, IntArray]:
    """Which vertices (n,) a mesh still uses with those to `keep` (n,), and its triangles (m, 3), numbered anew."""
    triangles = triangles[keep[triangles].all(axis=1)]
    used = np.zeros(len(keep), bool)
    used[triangles] = True
    return used, (np.cumsum(used) - 1)[triangles]


def window_surface(plane: Plane, camera: Camera) -> Surface | None:
    """Lay the convex polygon of a plane onto it, cut into triangles; None where nothing of it meets the plane."""
    weights, triangles = subdivision(len(plane.polygon_px))
    return lay_on_plane(plane, camera, weights @ np.asarray(plane.polygon_px, float), triangles)


@lru_cache
def subdivision(corners: int) -> tuple[FloatArray, IntArray]:
    """Cut a convex polygon of k corners into triangles, and each of these into four, twice.

    Returns points (n, k) as weighted means of the corners, which come first; neighbours share points. Triangles (m, 3)
    of their indices.
    """
    last = corners - 1
    triangles = np.array([(last, 0, 1), *((1, i, i + 1) for i in range(2, last))])
    points = np.eye(corners)
    for _ in range(2):  # enough to follow the curve that a lens makes of a straight border
        edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
        ends, inverse = np.unique(edges, axis=0, return_inverse=True)
        (a, b, c), (ab, bc, ca) = triangles.T, inverse.reshape(-1, 3).T + len(points)
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        triangles = np.vstack([np.column_stack(part) for part in parts])
        points = np.vstack([points, points[ends].mean(axis=1)])
    return points, triangles


_SURFACES: WeakKeyDictionary[Report, list[Surface]] = WeakKeyDictionary()


def surfaces_of(report: Report) -> list[Surface]:
    """Return the meshes of `region_surfaces`, none of a report of windows; made once for all files of a report."""
    if not report.found:
        return []
    if report not in _SURFACES:
        _SURFACES[report] = region_surfaces(report)
    return _SURFACES[report]


def region_surfaces(report: Report, most_triangles: int = MOST_TRIANGLES) -> list[Surface]:
    """Make the mesh of every plane whose footprint is given by its pixels in `labels`.

    The grids are as fine as `most_triangles` allows, never finer than pixels. Their borders run between the pixels.
    Left out is what rays meet at a grazing angle or `FARTHEST` times as far away as most of the scene.

    Returns
    -------
    One mesh per plane that has pixels in front of the camera, in the order of the report. Triangles are
    counter-clockwise seen from camera 1.
    """
    boxes = boxes_of(report.labels)
    ids = [plane.id for plane in report.planes if plane.found and plane.id in boxes]
    masks = {i: mask_of(report.labels[boxes[i]], i) for i in ids}
    n_pixels = sum(map(cv2.countNonZero, masks.values()))
    step = max(1.0, np.sqrt(2 * n_pixels / 0.8 / most_triangles))  # a first guess: a fifth lies along borders
    meshes = {i: region_grid(masks[i], boxes[i], step) for i in ids}
    while (count := sum(len(triangles) for _, triangles in meshes.values())) > most_triangles:
        step *= np.sqrt(1.1 * count / most_triangles)  # borders as rough as this are rare
        meshes = {i: region_grid(masks[i], boxes[i], step) for i in ids}
    laid = (lay_on_plane(p, report.cameras[0], *meshes[p.id]) for p in report.planes if p.id in meshes)
    return _without_far_parts([surface for surface in laid if surface is not None])


def _without_far_parts(surfaces: list[Surface]) -> list[Surface]:
    """Drop what is `FARTHEST` times as far from camera 1 as the median surface, or farther."""
    ranges = [np.linalg.norm(surface.points, axis=1) for surface in surfaces]
    reach = FARTHEST * float(np.median([np.median(each) for each in ranges])) if ranges else 0.0
    cut = (trimmed(surface, each < reach) for surface, each in zip(surfaces, ranges, strict=True))
    return [surface for surface in cut if surface is not None]


def region_grid(mask: Mask, box: Box, step: float) -> tuple[FloatArray, IntArray]:
    """Cover a region of the image with a grid of triangles that ends at its border.

    Parameters
    ----------
    mask : (h, w) uint8, 255 on the region's pixels.
    box : where the mask lies in the image.
    step : side of the grid's cells, px, at least 1; a narrow region gets smaller ones.

    Returns
    -------
    uv : (n, 2) px of the image.  triangles : (m, 3) indices into uv, counter-clockwise as seen in the image.
    """
    margin = int(np.ceil(step)) + 1
    side = max(1, int(step / 6))  # of squares of pixels, whose border looks the same at this step
    distance = _signed_distance(mask, margin, side)
    step = float(np.clip(distance.max() / 4, max(1.0, step / 4), step))
    depth, origin = _at_nodes(distance, np.array([box[1].start, box[0].start], float) - margin, step, side)
    inside = depth > 0
    corner, across, along = _number(inside)
    rows, columns = (grid.astype(float) for grid in np.indices(depth.shape))
    uv = [np.column_stack([columns[inside], rows[inside]])]
    for crossing, axis in ((across, 1), (along, 0)):
        r, c = np.nonzero(crossing >= 0)
        here, there = depth[r, c], depth[r + (axis == 0), c + (axis == 1)]
        share = np.clip(here / (here - there), 0.05, 0.95)  # clear of the nodes: no triangle is without an area
        uv.append(np.column_stack([c + share * (axis == 1), r + share * (axis == 0)]))
    return np.concatenate(uv) * step + origin, np.concatenate(list(_triangles(inside, corner, across, along)))


def _signed_distance(mask: Mask, margin: int, side: int) -> NDArray[np.float32]:
    """Distance of every square of `side` px to the border, positive inside, of the mask with a margin around it, px."""
    padded = np.pad(mask, [(margin, margin + -(n + 2 * margin) % side) for n in mask.shape])
    if side > 1:
        share = cv2.resize(padded, None, fx=1 / side, fy=1 / side, interpolation=cv2.INTER_AREA)
        padded = mask_of(share > 127, True)  # at least half of a square
    outer = cv2.distanceTransform(255 - padded, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # the blur of 1 px takes the staircase out of a slanting border, which a plane seen at an angle would enlarge
    return np.asarray(side * cv2.GaussianBlur(inner_distance(padded) - outer, (0, 0), 1.0), np.float32)


def _at_nodes(
    values: NDArray[np.float32], corner: FloatArray, step: float, side: int
) -> tuple[NDArray[np.float32], FloatArray]:
    """Sample values of squares of pixels, the first pixel at `corner`, at the nodes of a grid; and the first node, px.

    The nodes are multiples of the step from the image's corner on, so that grids of neighbours fit together.
    """
    first = np.ceil(corner / step)
    last = np.floor((corner + np.multiply(values.shape[::-1], side) - 1) / step)
    u, v = ((step * np.arange(first[i], last[i] + 1) - corner[i] + 0.5) / side - 0.5 for i in (0, 1))
    maps = np.meshgrid(u.astype(np.float32), v.astype(np.float32))
    return np.asarray(cv2.remap(values, maps[0], maps[1], cv2.INTER_LINEAR), np.float32), first * step


def _number(inside: NDArray[np.bool_]) -> tuple[IntArray, IntArray, IntArray]:
    """Vertex numbers of nodes inside, and of border crossings on the edges to the right and downwards; -1 for none."""
    kinds = (inside, inside[:, 1:] != inside[:, :-1], inside[1:] != inside[:-1])
    numbers, start = [], 0
    for kind in kinds:
        numbers.append(np.where(kind, start - 1 + np.cumsum(kind).reshape(kind.shape), -1))
        start += int(np.count_nonzero(kind))
    return numbers[0], numbers[1], numbers[2]


def _triangles(inside: NDArray[np.bool_], corner: IntArray, across: IntArray, along: IntArray) -> Iterator[IntArray]:
    """Triangles of all cells, kind by kind: which of a cell's corners are inside decides how it is cut."""
    around = (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:])  # against the clock, seen with v down
    sides = (along[:, :-1], across[1:], along[:, 1:], across[:-1])  # from each corner to the next
    kinds = sum(inside[where].astype(int) << i for i, where in enumerate(around))
    for kind in range(1, 16):
        cells = kinds == kind
        within = [bool(kind >> i & 1) for i in range(4)]
        outline: list[IntArray] = []
        for i in range(4):
            outline += [corner[around[i]][cells]] if within[i] else []
            outline += [sides[i][cells]] if within[i] != within[(i + 1) % 4] else []
        for second, third in pairwise(outline[1:]):
            yield np.column_stack([outline[0], second, third])
