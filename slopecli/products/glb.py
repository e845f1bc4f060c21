"""patches.glb: planes found as regions as one textured model, for any viewer of glTF.

Source: Khronos, "glTF 2.0 Specification", and its extension KHR_materials_unlit: the light is in the picture already.
Written here rather than by trimesh, which reads it back in the tests: importing it and exporting with it takes as much
processor time as all files together.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli import __version__
from slopecli.products.region_mesh import Surface, surfaces_of
from slopecli.products.slopes_json import rounded
from slopecli.types import AlternativePlane, FloatArray, Image, Plane, Report

LARGEST_TEXTURE_PX = 2048  # what every device can show
# by the type of the numbers: glTF's code for it, and for what a buffer of such numbers holds (vertices or indices)
COMPONENTS = {"<f4": (5126, 34962), "<u2": (5123, 34963), "<u4": (5125, 34963)}


def encode(report: Report, image: Image) -> bytes:
    """Return the content of patches.glb."""
    return report_to_glb(report, image, surfaces_of(report))


def report_to_glb(report: Report, image: Image, surfaces: Sequence[Surface]) -> bytes:
    """Serialise surfaces as a binary glTF 2.0 file: one node and mesh per plane, image 1 as their texture.

    glTF has y up and is looked at along -z: `model_from_camera1` turns camera-1 axes into these. The matrix, the unit
    and what is known of each plane are in the extras. The bytes are the same for the same input.

    Parameters
    ----------
    report : the finished answer; lengths are in the unit of its scale, although glTF knows metres only.
    image : image 1.
    surfaces : the planes, from `region_surfaces`.
    """
    rotation = model_from_camera1(np.array(report.up.vector_cam1))
    contents, others = _Contents(), report.ambiguity.others
    meshes = [_mesh(surface, rotation, image, contents, others.get(surface.plane.id)) for surface in surfaces]
    tree = {
        "asset": {"version": "2.0", "generator": f"slopemap {__version__}", "extras": _frame(report, rotation)},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"name": "planes", "nodes": list(range(len(meshes)))} if meshes else {"name": "planes"}],
    }
    if meshes:
        nodes = [
            {"name": mesh["name"], "mesh": i, "extras": _facts(surface.plane, others.get(surface.plane.id))}
            for i, (mesh, surface) in enumerate(zip(meshes, surfaces, strict=True))
        ]
        tree |= {"nodes": nodes, "meshes": meshes, **_texture(image, contents), **contents.tables()}
    return _packed(tree, bytes(contents.data))


def model_from_camera1(up_cam1: FloatArray) -> FloatArray:
    """Return the rotation (3, 3) from camera-1 axes to y up and -z ahead.

    Ahead is where camera 1 looks, seen on a map; where it looks steeply, what is up in its image is ahead.
    up_cam1 : (3,) vector against gravity, of any length.
    """
    up_cam1 = up_cam1 / np.linalg.norm(up_cam1)
    view, image_up = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
    ahead = view - (view @ up_cam1) * up_cam1
    if np.linalg.norm(ahead) < 0.5:  # the view is steeper than 60 deg
        ahead = image_up - (image_up @ up_cam1) * up_cam1
    ahead /= np.linalg.norm(ahead)
    return np.array([np.cross(ahead, up_cam1), up_cam1, -ahead])


@dataclass(eq=False)
class _Contents:
    """The binary part of the file, with the tables that say what lies where."""

    data: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)

    def add_bytes(self, content: bytes, **facts: int) -> int:
        """Append bytes and return the index of their view."""
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content), **facts})
        self.data += content + bytes(-len(content) % 4)
        return len(self.views) - 1

    def add_array(self, array: NDArray[Any]) -> int:
        """Append rows of vectors, or numbers, and return the index of their accessor."""
        component, target = COMPONENTS[array.dtype.str]
        view = self.add_bytes(array.tobytes(), target=target)
        kind = "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"
        low, high = (np.atleast_1d(end(array, axis=0)).tolist() for end in (np.min, np.max))
        count = {"count": len(array), "type": kind, "min": low, "max": high}
        self.accessors.append({"bufferView": view, "componentType": component, **count})
        return len(self.accessors) - 1

    def tables(self) -> dict[str, Any]:
        return {"accessors": self.accessors, "bufferViews": self.views, "buffers": [{"byteLength": len(self.data)}]}


def _mesh(
    surface: Surface, rotation: FloatArray, image: Image, contents: _Contents, other: AlternativePlane | None
) -> dict[str, Any]:
    """Store one surface. Without normals, viewers take those of the triangles, which is what a plane has."""
    points = (surface.points @ rotation.T).astype("<f4")
    texture = ((surface.uv + 0.5) / [image.width, image.height]).astype("<f4")
    attributes = {"POSITION": contents.add_array(points), "TEXCOORD_0": contents.add_array(texture)}
    kind = "<u2" if len(points) < 0xFFFF else "<u4"
    indices = contents.add_array(surface.triangles.astype(kind).ravel())
    planes = [plane for plane in (surface.plane, other) if plane is not None]
    slopes = [f"{plane.slope_deg:.1f} deg" if plane.slope_known else "slope not known" for plane in planes]
    told = "taken as level" if surface.plane.taken_as_level else " or ".join(slopes)
    name = f"plane {surface.plane.id} ({told})"
    return {"name": name, "primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}


def _texture(image: Image, contents: _Contents) -> dict[str, Any]:
    """Store image 1, no larger than need be, and the material that shows it as it is, from both sides."""
    pixels = image.grey if image.colour is None else image.colour
    scale = LARGEST_TEXTURE_PX / max(pixels.shape)
    if scale < 1.0:
        pixels = np.asarray(cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()
    view = contents.add_bytes(encoded)
    # read by viewers that do not know the extension: neither metal nor gloss
    surface = {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0, "roughnessFactor": 1.0}
    unlit: dict[str, Any] = {"KHR_materials_unlit": {}}
    return {
        "materials": [{"name": "image 1", "pbrMetallicRoughness": surface, "doubleSided": True, "extensions": unlit}],
        "textures": [{"source": 0, "sampler": 0}],
        "samplers": [{"wrapS": 33071, "wrapT": 33071}],  # clamped at the borders
        "images": [{"name": "image 1", "bufferView": view, "mimeType": "image/jpeg"}],
    }


def _frame(report: Report, rotation: FloatArray) -> dict[str, Any]:
    return {
        "unit": report.scale.unit,
        "axes": "x right, y up, -z ahead; the origin is camera 1",
        "model_from_camera1": [[rounded(value) for value in row] for row in rotation],
        "ambiguity": report.ambiguity.status,
        "level_in_doubt": report.up.otherwise_cam1 is not None,
    }


def _facts(plane: Plane, other: AlternativePlane | None) -> dict[str, Any]:
    facts = {"id": plane.id, **_slope_facts(plane), "verdict": plane.verdict, "status": plane.status}
    return facts if other is None else {**facts, "second_answer": _slope_facts(other)}


def _slope_facts(plane: Plane | AlternativePlane) -> dict[str, float | None]:
    slope_deg = plane.slope_deg if plane.slope_known else None
    numbers = {"slope_deg": slope_deg, "slope_sigma_deg": plane.slope_sigma_deg, "aspect_deg": plane.aspect_deg}
    return {name: None if value is None else rounded(value) for name, value in numbers.items()}


def _packed(tree: dict[str, Any], binary: bytes) -> bytes:
    """Join both parts of the file, each padded to four bytes as the format wants: text with blanks, data with zeros."""
    text = json.dumps(tree, separators=(",", ":"), allow_nan=False).encode("ascii")
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    if binary:
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
