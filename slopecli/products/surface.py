"""Meshes of planes: pixels of image 1 projected onto a plane along their rays, lens distortion included."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from slopecli.geometry.camera import points_on_plane
from slopecli.types import BoolArray, Camera, FloatArray, IntArray, Plane


@dataclass(frozen=True, eq=False)
class Surface:
    """Part of a plane: uv (n, 2) px of image 1, points (n, 3) in camera-1 axes, triangles (m, 3) of their indices."""

    plane: Plane
    uv: FloatArray
    points: FloatArray
    triangles: IntArray


def lay_on_plane(plane: Plane, camera: Camera, uv: FloatArray, triangles: IntArray) -> Surface | None:
    """Project a flat mesh in the image onto a plane.

    Parameters
    ----------
    plane : plane with `normal_cam1 . P = -distance`.
    camera : camera 1.
    uv : (n, 2) px of its image.
    triangles : (m, 3) indices into uv.

    Returns
    -------
    The part that meets the plane in front of the camera and not at a grazing angle, None where nothing does.
    """
    points, met = points_on_plane(camera, uv, plane.normal_cam1, plane.distance)
    return trimmed(Surface(plane, uv, points, triangles), met)


def trimmed(surface: Surface, keep: BoolArray) -> Surface | None:
    """Return what is left with the vertices to `keep` (n,) and the triangles between them, None if nothing is."""
    triangles = surface.triangles[keep[surface.triangles].all(axis=1)]
    if not len(triangles):
        return None
    used = np.zeros(len(keep), bool)
    used[triangles] = True
    renumbered = np.cumsum(used) - 1
    return Surface(surface.plane, surface.uv[used], surface.points[used], renumbered[triangles])
