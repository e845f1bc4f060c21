"""patches.ply: every plane as a mesh, with both cameras, z up or in camera-1 axes.

Windows have the colour of their slope, grey where it is not known, planes found as regions that of image 1.

Written here rather than by trimesh, which reads it back in the tests: trimesh writes no comments of ours, so unit and
frame would be lost, and importing it takes longer than solving a pair. The layout is what common viewers agree on:
triangles only (CloudCompare drops a mesh with larger faces), colours and normals per vertex (it ignores those of
faces), scalars named `scalar_...` for CloudCompare and one `quality` for MeshLab, no list but the faces'.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from slopecli import __version__
from slopecli.geometry.camera import points_on_plane
from slopecli.geometry.statistics import median
from slopecli.products.drawing.colours import slope_colours
from slopecli.products.drawing.marks import COLOURS
from slopecli.products.model_frame import frame_comments, model_rotation
from slopecli.products.region_mesh import Surface, kept_part, subdivision, surfaces_of
from slopecli.types import Camera, FloatArray, Image, IntArray, Plane, Report

UNKNOWN_SLOPE = -1.0  # no slope, and a number, as NaN upsets viewers

SCALARS = ("quality", "scalar_slope_deg", "scalar_sigma_slope_deg", "scalar_patch_id")
VERTEX = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
    + [(name, "u1") for name in ("red", "green", "blue")]
    + [(name, "<f4") for name in SCALARS]
)
_PLY_TYPES = {"<f4": "float", "|u1": "uchar"}


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices (n,) of dtype `VERTEX` and triangles (m, 3), counter-clockwise seen from their front."""

    vertices: NDArray[np.void]
    triangles: IntArray


def encode(report: Report, image: Image) -> bytes:
    """Return the content of patches.ply."""
    return report_to_ply(report, image, surfaces_of(report))


def report_to_ply(report: Report, image: Image | None = None, surfaces: Sequence[Surface] = ()) -> bytes:
    """Serialise planes and cameras as a binary PLY file.

    Source: Turk, "The PLY Polygon File Format", 1994.

    Parameters
    ----------
    report : the finished answer; lengths are in the unit of its scale.
    image : image 1, which colours the surfaces; without it they have the colour of their slope.
    surfaces : the planes that were found as regions, from `region_surfaces`.
    """
    windows = groupby((plane for plane in report.planes if not plane.found), lambda plane: len(plane.polygon_px))
    laid = (planes_mesh(list(alike), report.cameras[0]) for _, alike in windows)
    meshes = [*(mesh for mesh in laid if len(mesh.triangles)), *_surface_meshes(report, image, surfaces)]
    size = 0.06 * (median([plane.distance for plane in report.planes]) if report.planes else 1.0)
    rotation, centre = report.motion.rotation_cam2_from_cam1, report.motion.baseline_cam1
    meshes.append(_camera_mesh(report.cameras[0], np.eye(3), np.zeros(3), size, (40, 40, 40)))
    meshes.append(_camera_mesh(report.cameras[1], rotation, centre, size, (150, 150, 150)))
    comments = [
        f"slopemap {__version__}",
        *frame_comments(report),
        f"unit {report.scale.unit}",
        "scalars of the cameras are 0; scalar_patch_id is the id in slopes.json",
        f"scalar_slope_deg and quality are {UNKNOWN_SLOPE:g} where the slope is not known",
    ]
    return _encode(meshes, model_rotation(report), [*comments, *_level(report), *_second_answer(report)])


def _level(report: Report) -> list[str]:
    """Comments on what is level, where it was assumed."""
    plane_id, other = report.up.plane_id, report.up.otherwise_cam1
    told = [] if plane_id is None else [f"patch {plane_id} is taken as level, by definition"]
    return told if other is None else [*told, "what is level is in doubt: see level-assumed in slopes.json"]


def _second_answer(report: Report) -> list[str]:
    """Comments with the slopes of the second root: a mesh can show one only."""
    told = []
    for other in report.ambiguity.others.values():
        sigma = "taken as level" if other.slope_sigma_deg is None else f"1-sigma {other.slope_sigma_deg:.2f} deg"
        slope = f"slope {other.slope_deg:.2f} deg, {sigma}"
        told.append(f"patch {other.id} in the second answer: {slope if other.slope_known else 'not known'}")
    return ["two answers: this is the first, a second one fits as well", *told] if told else []


def planes_mesh(planes: Sequence[Plane], camera: Camera) -> Mesh:
    """Lay the footprints of planes onto them, as triangles whose fronts face camera 1.

    What does not meet its plane in front of the camera is left out.

    Parameters
    ----------
    planes : with `normal_cam1 . P = -distance`; their polygons convex, of as many corners each, in px of `camera`.
    camera : camera 1.
    """
    weights, triangles = subdivision(len(planes[0].polygon_px))
    uv = weights @ np.array([plane.polygon_px for plane in planes], float)
    count = len(weights)
    normals, distances, colours, numbers = (
        np.repeat(np.array(values), count, axis=0)
        for values in (
            [plane.normal_cam1 for plane in planes],
            [plane.distance for plane in planes],
            _colours(planes),
            [_scalars(plane) for plane in planes],
        )
    )
    points, met = points_on_plane(camera, uv.reshape(-1, 2), normals, distances)
    every = (triangles + count * np.arange(len(planes))[:, None, None]).reshape(-1, 3)
    used, kept = kept_part(every, met)
    points, normals = points[used], normals[used]
    vertices = _vertices(points, normals, colours[used])
    for name, column in zip(SCALARS, numbers[used].T, strict=True):
        vertices[name] = column
    return Mesh(vertices, _facing(points, kept, normals[kept[:, 0]]))


def _colours(planes: Sequence[Plane]) -> NDArray[np.uint8]:
    """(n, 3) RGB of the slopes of planes, grey where they are not known."""
    known = np.array([plane.slope_known for plane in planes])
    told = slope_colours([plane.slope_deg if plane.slope_known else 0.0 for plane in planes])
    return np.where(known[:, None], told, np.array(COLOURS["no answer"], np.uint8))


def _surface_mesh(surface: Surface, colours: ArrayLike) -> Mesh:
    """Mesh of a part of a plane, with what is known of the plane at every vertex."""
    plane = surface.plane
    vertices = _vertices(surface.points, plane.normal_cam1, colours)
    for name, value in zip(SCALARS, _scalars(plane), strict=True):
        vertices[name] = value
    return Mesh(vertices, _facing(surface.points, surface.triangles, plane.normal_cam1))


def _scalars(plane: Plane) -> tuple[float, float, float, int]:
    """What is known of a plane at every vertex, in the order of `SCALARS`."""
    slope = plane.slope_deg if plane.slope_known else UNKNOWN_SLOPE
    sigma = plane.slope_sigma_deg or 0.0
    return slope, slope, sigma if math.isfinite(sigma) else 0.0, plane.id


def _surface_meshes(report: Report, image: Image | None, surfaces: Sequence[Surface]) -> list[Mesh]:
    if image is None or not surfaces:
        return [_surface_mesh(each, _colours([each.plane])[0]) for each in surfaces]
    # a vertex stands for the pixels nearest to it, and has their mean colour
    spacing = np.sqrt(np.count_nonzero(report.labels) / max(1, sum(len(each.uv) for each in surfaces)))
    pixels = cv2.cvtColor(image.grey, cv2.COLOR_GRAY2RGB) if image.colour is None else image.colour[:, :, ::-1]
    pixels = cv2.blur(pixels, (max(1, round(spacing)),) * 2)
    most = [image.width - 1, image.height - 1]
    nearest = [np.clip(np.rint(each.uv).astype(int), 0, most).T for each in surfaces]
    return [_surface_mesh(each, pixels[v, u]) for each, (u, v) in zip(surfaces, nearest, strict=True)]


def _camera_mesh(camera: Camera, rotation: FloatArray, centre: FloatArray, size: float, colour: Sequence[int]) -> Mesh:
    """A camera as a pyramid: apex at its centre (3,), camera-1 axes, base `size` ahead along its axis.

    rotation : (3, 3) from camera 1 to this camera.
    """
    corners = np.array([[0, 0], [camera.width, 0], [camera.width, camera.height], [0, camera.height]])
    base = np.column_stack([(corners - [camera.cx, camera.cy]) / [camera.fx, camera.fy], np.ones(4)])
    local = size * np.vstack([np.zeros(3), base])
    outward = local - local.mean(axis=0)
    normals = outward / np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-300)
    sides = [[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4], [1, 2, 3], [1, 3, 4]]
    return Mesh(_vertices(local @ rotation + centre, normals @ rotation, colour), np.array(sides))


def _facing(points: FloatArray, triangles: IntArray, normals: FloatArray) -> IntArray:
    """Turn triangles so that they are counter-clockwise seen against the normals, (3,) or (m, 3)."""
    a, b, c = points[triangles].transpose(1, 0, 2)
    backwards = (np.cross(b - a, c - a) * normals).sum(axis=1) < 0
    return np.where(backwards[:, None], triangles[:, ::-1], triangles)


def _vertices(points: FloatArray, normals: FloatArray, colour: ArrayLike) -> NDArray[np.void]:
    vertices = np.zeros(len(points), VERTEX)
    for columns, values in (("x y z", points), ("nx ny nz", normals), ("red green blue", colour)):
        for name, column in zip(columns.split(), np.broadcast_to(values, (len(points), 3)).T, strict=True):
            vertices[name] = column
    return vertices


def _encode(meshes: Sequence[Mesh], rotation: FloatArray, comments: Sequence[str]) -> bytes:
    """The file; rotation (3, 3): from camera-1 axes to its own."""
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    for names in (("x", "y", "z"), ("nx", "ny", "nz")):
        turned = np.column_stack([vertices[name] for name in names]).astype(float) @ rotation.T
        for name, column in zip(names, turned.T, strict=True):
            vertices[name] = column
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    triangles = np.vstack([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)])
    faces = np.zeros(len(triangles), [("count", "u1"), ("vertex_indices", "<i4", (3,))])
    faces["count"], faces["vertex_indices"] = 3, triangles
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {comment}" for comment in comments),
        f"element vertex {len(vertices)}",
        *(f"property {_PLY_TYPES[VERTEX[name].str]} {name}" for name in VERTEX.names or ()),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    return "\n".join(header).encode("ascii") + b"\n" + vertices.tobytes() + faces.tobytes()
