"""overlay.png: image 1 with every patch tinted by its slope, labelled, and its verdict shown by more than colour."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.camera import rays_from_pixels
from slopecli.io import marks
from slopecli.io.colormap import slope_colours
from slopecli.io.legend import draw_banner, draw_legend
from slopecli.io.lettering import Text, badge_centre, box_around, label_texts, write
from slopecli.io.marks import Picture
from slopecli.io.placement import Footprint, Placed, place_labels
from slopecli.types import Camera, FloatArray, Image, Plane, Rejected, Report

SMALLEST_PX, LARGEST_PX = 640, 2000  # long side of the drawing: legible below, quick to write and to open above
TINT = 0.6  # share of the slope's colour; the rest keeps the ground recognisable
TEXT_PX = 15  # at a long side of 1024 px


def draw_overlay(report: Report, image: Image) -> NDArray[np.uint8]:
    """Draw the answer over image 1, with a legend below and, if the answer is ambiguous, a banner above.

    The drawing is image 1 scaled so that its long side lies within `SMALLEST_PX`..`LARGEST_PX`.

    Parameters
    ----------
    report : the finished answer.
    image : image 1, the one whose pixels `report` speaks of.

    Returns
    -------
    (h, w, 3) uint8 BGR; higher than the image by legend and banner.
    """
    scale = float(np.clip(1.0, SMALLEST_PX / max(image.grey.shape), LARGEST_PX / max(image.grey.shape)))
    picture = _background(image, scale)
    text_px = max(12, round(TEXT_PX * max(picture.shape) / 1024))
    footprints = _footprints(report, scale, picture.shape[:2])
    _draw_patches(picture, _resized(image.grey, scale), footprints, text_px)
    focus = _focus(report, scale, picture)
    picture = _annotate(picture, footprints, focus, text_px)
    width = picture.shape[1]
    sheets = [*draw_banner(report, width, text_px), picture, draw_legend(report, width, text_px, focus is not None)]
    return _converted(np.vstack(sheets), cv2.COLOR_RGB2BGR)


def _background(image: Image, scale: float) -> Picture:
    if image.colour is None:
        return _converted(_resized(image.grey, scale), cv2.COLOR_GRAY2RGB)
    return _converted(_resized(image.colour, scale), cv2.COLOR_BGR2RGB)


def _converted(pixels: NDArray[np.uint8], code: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(pixels, code), np.uint8)


def _resized(pixels: NDArray[np.uint8], scale: float) -> NDArray[np.uint8]:
    if scale == 1.0:
        return pixels
    method = cv2.INTER_AREA if scale < 1.0 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=method), np.uint8)


def _footprints(report: Report, scale: float, shape: tuple[int, int]) -> list[Footprint]:
    """Patches that touch the picture, largest first; where two overlap, the smaller has the ground."""
    others = _other_slopes(report)
    items: list[Plane | Rejected] = [*report.planes, *report.rejected]
    found = []
    for item in items:
        polygon = (np.asarray(item.polygon_px, float) + 0.5) * scale - 0.5
        low = np.clip(np.floor(polygon.min(axis=0)).astype(int), 0, None)
        high = np.minimum(np.ceil(polygon.max(axis=0)).astype(int) + 1, shape[::-1])
        if (high <= low).any():
            continue
        mask = marks.polygon_mask(polygon - low, (int(high[1] - low[1]), int(high[0] - low[0])))
        downhill = downhill_px(report, item) if isinstance(item, Plane) else None
        found.append(Footprint(item, polygon, mask, (int(low[0]), int(low[1])), downhill, others.get(item.id)))
    found.sort(key=lambda footprint: -cv2.countNonZero(footprint.mask))
    _share_ground(found, shape)
    return found


def _share_ground(footprints: Sequence[Footprint], shape: tuple[int, int]) -> None:
    """Take from every mask what a later footprint covers, unless nothing would be left of it."""
    owner = np.full(shape, -1, np.int32)
    for index, footprint in enumerate(footprints):
        footprint.crop(owner)[footprint.mask > 0] = index
    for index, footprint in enumerate(footprints):
        own = footprint.crop(owner) == index
        if own.any():
            footprint.mask[~own] = 0


def _other_slopes(report: Report) -> dict[int, float]:
    """Slopes of the second answer by plane id, while it is not known which answer holds."""
    if report.ambiguity.status != "unresolved" or report.ambiguity.alternative is None:
        return {}
    return {plane.id: plane.slope_deg for plane in report.ambiguity.alternative.planes}


def downhill_px(report: Report, plane: Plane) -> FloatArray | None:
    """Return the direction in image 1 in which the plane falls, at the middle of its polygon.

    Returns
    -------
    (2,) unit vector (right, down) in pixels, or None for a plane whose downhill direction is undefined.
    """
    if plane.aspect_deg is None:
        return None
    up, normal = np.array(report.up.vector_cam1), np.asarray(plane.normal_cam1)
    fall = (up @ normal) * normal - up
    ray, ray_by_px = _ray_and_slope(report.cameras[0], np.asarray(plane.polygon_px, float).mean(axis=0))
    motion = fall[:2] - ray * fall[2]  # of the normalised coordinate, times depth
    direction = np.linalg.solve(ray_by_px, motion)
    length = np.linalg.norm(direction)
    return direction / length if length > 0 else None  # NaN where the lens has no ray compares false too


def _ray_and_slope(camera: Camera, uv: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(2,) normalised ray of a pixel and (2, 2) its derivative, lens distortion included."""
    rays = rays_from_pixels(camera, uv + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    return rays[0], (rays[1:] - rays[0]).T


def _draw_patches(picture: Picture, grey: NDArray[np.uint8], footprints: Sequence[Footprint], text_px: int) -> None:
    for footprint in footprints:
        painted = _tinted(footprint, footprint.crop(grey))
        line = max(1, round(min(text_px / 6, footprint.size / 30)))
        marks.paint_verdict(painted, footprint.polygon - footprint.corner, footprint.verdict, line)
        cv2.copyTo(painted, footprint.mask, footprint.crop(picture))


def _tinted(footprint: Footprint, grey: NDArray[np.uint8]) -> Picture:
    """Ground under one patch in the colour of its slope; grey without colour where there is no answer."""
    item = footprint.item
    colour = slope_colours(item.slope_deg)[0] if isinstance(item, Plane) else np.array(marks.NO_ANSWER)
    levels = (1 - TINT) * np.arange(256.0)[:, None] + TINT * colour
    return np.asarray(cv2.LUT(_converted(grey, cv2.COLOR_GRAY2RGB), levels.astype(np.uint8)[:, None]), np.uint8)


def _focus(report: Report, scale: float, picture: Picture) -> FloatArray | None:
    """Epipole of camera 2 on the picture, (2,) px, when it lies inside."""
    if report.epipole1_px is None or not np.isfinite(report.epipole1_px).all():
        return None
    focus = (np.array(report.epipole1_px) + 0.5) * scale - 0.5
    inside = (focus >= 0).all() and (focus < picture.shape[1::-1]).all()
    return focus if inside else None


def _annotate(picture: Picture, footprints: Sequence[Footprint], focus: FloatArray | None, text_px: int) -> Picture:
    """Draw focus, arrows, leaders and badges, then all text."""
    obstacles = [] if focus is None else [box_around(focus, np.full(2, 2.6 * text_px))]
    placed = place_labels(footprints, obstacles, (picture.shape[0], picture.shape[1]), text_px)
    if focus is not None:
        marks.focus_mark(picture, focus, 0.75 * text_px)
    texts: list[Text] = []
    for one in placed:
        _draw_pointers(picture, one, text_px)
        if one.label.badge:
            marks.badge(picture, one.label.badge, badge_centre(one.label, one.centre), one.label.badge_radius)
        texts += label_texts(one.label, one.centre)
    return write(picture, texts)


def _draw_pointers(picture: Picture, one: Placed, text_px: int) -> None:
    """Draw the downhill arrow, and a leader from a label that stands apart from its patch."""
    if one.outside:
        leader = one.leader()
        if np.linalg.norm(leader[1] - leader[0]) > 0.7 * text_px:
            marks.cased_stroke(picture, leader, marks.PAPER, max(1, text_px // 10))
    if one.footprint.downhill is not None and one.arrow_length > 0:
        width = min(0.3 * text_px, 0.2 * one.arrow_length)
        marks.arrow(picture, one.arrow_tail, one.footprint.downhill, one.arrow_length, width)
