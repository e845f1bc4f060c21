"""patches.ply: every plane as a mesh, with both cameras, z up or in camera-1 axes.

Windows have the colour of their slope, grey where it is not known, planes found as regions that of image 1.

Written here rather than by trimesh, which reads it back in the tests: trimesh writes no comments of ours, so unit and
frame would be lost, and importing it takes longer than solving a pair. The layout is what common viewers agree on:
triangles only (CloudCompare drops a mesh with larger faces), colours and normals per vertex (it ignores those of
faces), scalars named `scalar_...` for CloudCompare and one `quality` for MeshLab, no list but the faces'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from slopecli import __version__
from slopecli.geometry.statistics import median
from slopecli.products.drawing.colours import slope_colours
from slopecli.products.drawing.marks import NO_ANSWER
from slopecli.products.model_frame import frame_comments, model_rotation
from slopecli.products.region_mesh import Surface, surfaces_of, window_surface
from slopecli.types import Camera, FloatArray, Image, IntArray, Plane, Report

UNKNOWN_SLOPE = -1.0  # no slope, and a number, as NaN upsets viewers

VERTEX = np.dtype(
    [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
    + [(name, "u1") for name in ("red", "green", "blue")]
    + [(name, "<f4") for name in ("quality", "scalar_slope_deg", "scalar_sigma_slope_deg", "scalar_patch_id")]
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
    windows = (plane_mesh(plane, report.cameras[0]) for plane in report.planes if not plane.found)
    meshes = [*(mesh for mesh in windows if mesh is not None), *_surface_meshes(report, image, surfaces)]
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


def plane_mesh(plane: Plane, camera: Camera) -> Mesh | None:
    """Lay the footprint of a plane onto it, as triangles whose front faces camera 1.

    Parameters
    ----------
    plane : plane with `normal_cam1 . P = -distance`, its polygon convex, in px of `camera`.
    camera : camera 1.

    Returns
    -------
    The mesh, or None where no part of the footprint meets the plane in front of the camera.
    """
    surface = window_surface(plane, camera)
    return None if surface is None else _surface_mesh(surface, _colour(plane))


def _colour(plane: Plane) -> ArrayLike:
    """RGB of a plane's slope, grey where it is not known."""
    return slope_colours(plane.slope_deg)[0] if plane.slope_known else NO_ANSWER


def _surface_mesh(surface: Surface, colours: ArrayLike) -> Mesh:
    """Mesh of a part of a plane, with what is known of the plane at every vertex."""
    plane = surface.plane
    vertices = _vertices(surface.points, plane.normal_cam1, colours)
    vertices["quality"] = vertices["scalar_slope_deg"] = plane.slope_deg if plane.slope_known else UNKNOWN_SLOPE
    vertices["scalar_sigma_slope_deg"] = np.nan_to_num(plane.slope_sigma_deg or 0.0)
    vertices["scalar_patch_id"] = plane.id
    return Mesh(vertices, _facing(surface.points, surface.triangles, plane.normal_cam1))


def _surface_meshes(report: Report, image: Image | None, surfaces: Sequence[Surface]) -> list[Mesh]:
    if image is None or not surfaces:
        return [_surface_mesh(each, _colour(each.plane)) for each in surfaces]
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


def _facing(points: FloatArray, triangles: IntArray, normal: FloatArray) -> IntArray:
    """Turn triangles so that they are counter-clockwise seen against the normal."""
    a, b, c = points[triangles].transpose(1, 0, 2)
    backwards = np.cross(b - a, c - a) @ normal < 0
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
