"""A frame of a sequence with the windows where their planes put them, their slopes and verdicts."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.homography import apply_homography
from slopecli.products.drawing.canvas import converted, text_size
from slopecli.products.drawing.colours import slope_colours
from slopecli.products.drawing.lettering import Text, write
from slopecli.products.drawing.marks import COLOURS, Picture
from slopecli.report.slope_units import SlopeUnit, slope_unit_of
from slopecli.types import Camera, FloatArray, Image, Motion, Plane, Report


def draw_frame(
    image: Image, report: Report | None, motion: Motion | None, camera: Camera, note: str
) -> NDArray[np.uint8]:
    """Draw the answer over a frame, (h, w, 3) uint8 BGR.

    report, motion : of the frame; None while there is no answer, or where the frame was skipped.
    note : one line, written at the top.
    """
    colour = image.grey if image.colour is None else image.colour
    picture = converted(colour, cv2.COLOR_GRAY2RGB if image.colour is None else cv2.COLOR_BGR2RGB)
    size = text_size(picture)
    texts = [Text((0.5 * size, 0.8 * size), note, size)]
    for plane in report.planes if report is not None and motion is not None else ():
        outline = None if motion is None else _outline(plane, motion, camera)
        if outline is None:
            continue
        _stroke(picture, outline, plane, max(2, size // 6))
        texts += _label(outline.mean(axis=0), plane, slope_unit_of(report.options if report else {}), size)
    return converted(write(picture, texts), cv2.COLOR_RGB2BGR)


def _outline(plane: Plane, motion: Motion, camera: Camera) -> FloatArray | None:
    """(k, 2) px of a window's outline in the frame, lens included; None where it is behind or far outside it."""
    corners = plane.polygon_px
    steps = np.linspace(0.0, 1.0, 8, endpoint=False)[:, None]
    following = np.roll(corners, -1, axis=0)
    border = np.concatenate([a + steps * (b - a) for a, b in zip(corners, following, strict=True)])
    rays = homogeneous(rays_from_pixels(camera, border))
    normal = -plane.normal_cam1 / plane.distance
    H = motion.rotation_cam2_from_cam1 @ (np.eye(3) - np.outer(motion.baseline_cam1, normal))
    if not np.isfinite(rays).all() or ((rays @ H.T)[:, 2] <= 0.0).any():
        return None
    uv = pixels_from_rays(camera, apply_homography(H, rays[:, :2]))
    near = np.abs(uv) < 10.0 * max(camera.width, camera.height)
    return uv if near.all() else None


def _stroke(picture: Picture, outline: FloatArray, plane: Plane, width: int) -> None:
    """The outline in the colour of the slope, on a dark edge; broken where the verdict is open."""
    points = [np.round(outline * 16).astype(np.int32)]
    colour = tuple(int(c) for c in slope_colours(plane.slope_deg)[0])
    cv2.polylines(picture, points, True, COLOURS["ink"], width + 2, cv2.LINE_AA, shift=4)
    cv2.polylines(picture, points, True, colour, width, cv2.LINE_AA, shift=4)


def _label(centre: FloatArray, plane: Plane, unit: SlopeUnit, size: int) -> list[Text]:
    """Id, slope and verdict in the middle of a window."""
    u, v = centre.tolist()
    sigma_deg = plane.slope_sigma_deg
    slope = unit.whole(plane.slope_deg) if sigma_deg is None else unit.short(plane.slope_deg, sigma_deg)
    rows = (f"{plane.id}: {slope}", plane.verdict or "level")
    return [Text((u, v + (k - 0.5) * 1.2 * size), row, size, "mm") for k, row in enumerate(rows)]
