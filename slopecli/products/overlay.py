"""overlay.png: image 1 with every patch tinted by its slope, labelled, and hatched and framed by its verdict."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.products.drawing import marks
from slopecli.products.drawing.canvas import converted, drawing_scale, ground, resized, text_size
from slopecli.products.drawing.colours import slope_colours
from slopecli.products.drawing.legend import draw_banner, draw_legend
from slopecli.products.drawing.lettering import Text, badge_centre, label_texts, write
from slopecli.products.drawing.marks import LAYOUT, Picture
from slopecli.products.drawing.outlines import Footprint, footprints_of
from slopecli.products.drawing.placement import Placed, box_around, place_labels
from slopecli.report.kinds import many_windows
from slopecli.types import FloatArray, Image, Report


def draw_overlay(report: Report, image: Image) -> NDArray[np.uint8]:
    """Draw the answer over image 1, with a legend below and, if the answer is ambiguous, a banner above.

    Of many windows it is a map in classes of slope. Else the drawing is image 1, enlarged or reduced where it would not
    be legible or quick to open (`drawing_scale`).

    Parameters
    ----------
    report : the finished answer.
    image : image 1.

    Returns
    -------
    (h, w, 3) uint8 BGR; higher than the image by legend and banner.
    """
    if many_windows(report):
        from slopecli.products.windows_picture import draw_windows

        return draw_windows(report, image)
    scale = drawing_scale(report, image)
    picture = ground(image, scale)
    text_px = text_size(picture)
    footprints = footprints_of(report, scale, (picture.shape[0], picture.shape[1]), text_px)
    _draw_patches(picture, resized(image.grey, scale), footprints, text_px)
    focus = _focus(report, scale, picture)
    picture = _annotate(picture, footprints, focus, text_px)
    width = picture.shape[1]
    sheets = [*draw_banner(report, width, text_px), picture, draw_legend(report, width, text_px, focus is not None)]
    return converted(np.vstack(sheets), cv2.COLOR_RGB2BGR)


def _draw_patches(picture: Picture, grey: NDArray[np.uint8], footprints: Sequence[Footprint], text_px: int) -> None:
    for footprint in footprints:
        painted = _tinted(footprint, footprint.crop(grey))
        line = max(1, round(min(text_px / 6, footprint.size / (30 if footprint.pieces is None else 60))))
        outlines = [outline - footprint.corner for outline in footprint.outlines]
        marks.paint_verdict(painted, outlines, footprint.verdict, line, curved=footprint.pieces is not None)
        if footprint.pieces is None:
            cv2.copyTo(painted, footprint.mask, footprint.crop(picture))
        else:
            marks.lay_over(footprint.crop(picture), painted, footprint.pieces.cover)


def _tinted(footprint: Footprint, grey: NDArray[np.uint8]) -> Picture:
    """Ground under one patch in the colour of its slope; grey without colour where it is not known."""
    slope_deg = footprint.slope_deg
    colour = np.array(marks.COLOURS["no answer"]) if slope_deg is None else slope_colours(slope_deg)[0]
    levels = (1 - LAYOUT["tint"]) * np.arange(256.0)[:, None] + LAYOUT["tint"] * colour
    return np.asarray(cv2.LUT(converted(grey, cv2.COLOR_GRAY2RGB), levels.astype(np.uint8)[:, None]), np.uint8)


def _focus(report: Report, scale: float, picture: Picture) -> FloatArray | None:
    """Epipole of camera 2 on the picture, (2,) px, when it lies inside."""
    if report.epipole1_px is None or not np.isfinite(report.epipole1_px).all():
        return None
    focus = (np.array(report.epipole1_px) + 0.5) * scale - 0.5
    inside = (focus >= 0).all() and (focus < picture.shape[1::-1]).all()
    return focus if inside else None


def _annotate(picture: Picture, footprints: Sequence[Footprint], focus: FloatArray | None, text_px: int) -> Picture:
    """Draw the focus and all labels."""
    obstacles = [] if focus is None else [box_around(focus, np.full(2, 2.6 * text_px))]
    placed = place_labels(footprints, obstacles, (picture.shape[0], picture.shape[1]), text_px)
    if focus is not None:
        marks.focus_mark(picture, focus, 0.75 * text_px)
    return draw_labels(picture, placed, text_px)


def draw_labels(picture: Picture, placed: Sequence[Placed], text_px: int) -> Picture:
    """Return a picture, itself drawn on, with labels where they were placed: leaders, arrows, badges, then all text."""
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
            marks.cased_stroke(picture, leader, marks.COLOURS["paper"], max(1, text_px // 10))
    if one.footprint.downhill is not None and one.arrow_length > 0:
        width = min(0.3 * text_px, 0.2 * one.arrow_length)
        marks.arrow(picture, one.arrow_tail, one.footprint.downhill, one.arrow_length, width)
