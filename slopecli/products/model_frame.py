"""Axes of the point clouds and meshes that are written: z up, as viewers expect, or those of camera 1."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.slope import north_direction
from slopecli.types import FloatArray, Report


def model_rotation(report: Report) -> FloatArray:
    """Return the rotation (3, 3) from camera-1 axes to those of the models: camera 1 stays the origin.

    Rows are the axes: z is up, y what aspects count from (the north given, or the image's up direction), made
    horizontal, x to the right of it. With the option `ply_frame` "camera" the axes stay.
    """
    if report.options.get("ply_frame") == "camera":
        return np.eye(3)
    north = report.options.get("north")
    return level_axes(np.array(report.up.vector_cam1, float), None if north is None else np.array(north, float))


def level_axes(up: FloatArray, north: FloatArray | None = None) -> FloatArray:
    """Return axes (3, 3), a row each, in camera-1 axes: right, ahead (see `north_direction`), and up (3,)."""
    up = up / np.linalg.norm(up)
    ahead = north_direction(up, north)
    return np.array([np.cross(ahead, up), ahead, up])


def frame_comments(report: Report) -> list[str]:
    """Return what a header says of the axes: their names, and the way back to those of camera 1, row by row."""
    if report.options.get("ply_frame") == "camera":
        return ["frame camera 1: x right, y down, z forward"]
    A = np.where(np.abs(A := model_rotation(report)) < 5e-10, 0.0, A)  # no "-0.000000000"
    y = "image's up direction" if report.options.get("north") is None else "north"
    rows = (" ".join(f"{value:.9f}" for value in row) for row in A)
    return [
        f"frame z up, y {y} made horizontal, x to the right of it; the origin is camera 1",
        "model = A camera1, camera-1 axes: x right, y down, z forward; rows of A:",
        *(f"A{i} {row}" for i, row in enumerate(rows, 1)),
    ]
