"""Marks on a map of the ground: the edge at the tolerance, landing sites, direction of north, a scale bar."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.ground.slope_map import Site, SlopeMap
from slopecli.products.drawing import marks
from slopecli.products.drawing.canvas import Frame
from slopecli.products.drawing.lettering import Text, write
from slopecli.products.drawing.marks import COLOURS, Picture, lay_colour
from slopecli.products.drawing.outlines import motion_px
from slopecli.types import BoolArray, FloatArray

SEEN_ALONG = 0.1  # sine of the angle between a direction and the ray, below which its image tells nothing


def draw_tolerance_edge(picture: Picture, steep: BoolArray, valid: BoolArray, cell_px: float, text_px: int) -> None:
    """Draw a dark line with a light rim between valid pixels that are steep and valid ones that are not.

    The line is rounded within half a cell, so that it does not follow the corners of cells. There is none along the
    border of what is not valid.

    Parameters
    ----------
    steep, valid : (h, w) bool, pixels of the picture.  cell_px : side of a cell on the picture, px.
    """
    edge = _edge_between(steep & valid, valid, cell_px)
    if not edge.any():
        return
    away = cv2.distanceTransform(np.multiply(~edge, 1, dtype=np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    half = 0.075 * text_px
    for colour, reach in ((COLOURS["paper"], half + max(1.2, 0.07 * text_px)), (COLOURS["ink"], half)):
        cover = np.rint(255.0 * np.clip(reach + 0.5 - away, 0.0, 1.0)).astype(np.uint8)
        lay_colour(picture, colour, cover)


def _edge_between(steep: BoolArray, valid: BoolArray, cell_px: float) -> BoolArray:
    """(h, w) whether a valid pixel has a valid neighbour, right or below, on the other side."""
    sigma = max(0.6 * cell_px, 0.8)
    weight = cv2.GaussianBlur(valid.astype(np.float32), (0, 0), sigma)
    share = cv2.GaussianBlur(steep.astype(np.float32), (0, 0), sigma) / np.maximum(weight, np.float32(1e-6))
    side, edge = share > 0.5, np.zeros(valid.shape, bool)
    edge[:, :-1] |= valid[:, :-1] & valid[:, 1:] & (side[:, :-1] != side[:, 1:])
    edge[:-1] |= valid[:-1] & valid[1:] & (side[:-1] != side[1:])
    return edge


def edge_sign(picture: Picture, centre: np.ndarray, radius: float) -> None:
    """Draw the sign of the edge at the tolerance."""
    ends = centre + 2.6 * radius * np.array([[-1.0, 0.0], [1.0, 0.0]])
    marks.stroke(picture, ends, (150, 150, 150), max(5, round(0.7 * radius)))  # as white does not show on paper
    marks.stroke(picture, ends, COLOURS["paper"], max(3, round(0.5 * radius)))
    marks.stroke(picture, ends, COLOURS["ink"], max(1, round(0.25 * radius)))


def draw_sites(picture: Picture, sites: Sequence[Site], frame: Frame) -> None:
    """Draw landing sites as numbered circles, the best on top."""
    text_px = frame.text_px
    placed = [(frame.place(site.centre_px), site.radius_px * frame.scale, site) for site in reversed(sites)]
    line = max(2, round(text_px / 6))
    for centre, radius, site in placed:
        site_circle(picture, centre, radius, site.verdict == "safe", line)
    size, half = round(1.25 * text_px), 0.95 * text_px
    most = np.array(picture.shape[1::-1]) - 1.0 - half
    for centre, radius, site in placed:
        at = np.clip(centre + max(radius, 1.5 * half) * np.array([0.707, -0.707]), half, np.maximum(most, half))
        marks.disc(picture, at, 1.12 * half, COLOURS["ink"])
        marks.disc(picture, at, half, COLOURS["paper"])
        write(picture, [Text((float(at[0]), float(at[1])), str(site.id), size, "mm", COLOURS["ink"], None)])


def site_circle(
    picture: Picture, centre: FloatArray, radius: float, safe: bool, line: int, *, centred: bool = True
) -> None:
    """Draw the circle of a site and, if `centred`, a dot in it: white, or dashed and yellow where it may be unsafe."""
    marks.disc(picture, centre, radius, COLOURS["ink"], line + 4)
    if centred:
        marks.disc(picture, centre, 1.2 * line + 2, COLOURS["ink"])
        marks.disc(picture, centre, 1.2 * line, COLOURS["paper"] if safe else COLOURS["caution"])
    if safe:
        marks.disc(picture, centre, radius, COLOURS["paper"], line)
        return
    turns = np.linspace(0.0, 2.0 * np.pi, 73)[:-1]
    circle = centre + radius * np.column_stack([np.cos(turns), np.sin(turns)])
    for dash in marks.curve_dashes(circle, 7.0 * line):
        marks.stroke(picture, dash, COLOURS["caution"], line)


def north_px(slope_map: SlopeMap) -> FloatArray | None:
    """Return the direction of north near the middle of image 1, (2,) unit vector (right, down).

    Without a north given it is the image's up direction; None where the camera looks along it.
    """
    if slope_map.north_cam1 is None:
        return np.array([0.0, -1.0])
    up, north = np.array(slope_map.report.up.vector_cam1), np.array(slope_map.north_cam1)
    level = north - (north @ up) * up
    length = float(np.linalg.norm(level))
    camera = slope_map.report.cameras[0]
    middle = np.array([camera.width - 1.0, camera.height - 1.0]) / 2.0
    motion = motion_px(camera, middle, level / length) if length > SEEN_ALONG else np.zeros(2)
    size = float(np.linalg.norm(motion))
    return (
        motion / size if size > SEEN_ALONG * camera.focal_px else None
    )  # NaN where the lens has no ray compares false


def bar_length_m(slope_map: SlopeMap, scale: float, longest_px: float) -> tuple[float, float] | None:
    """Return the length of a scale bar, 1, 2 or 5 times a power of ten in m, and in px; None without metres.

    scale : of the picture against image 1.  longest_px : of the picture, that the bar may have.
    """
    px_per_m = scale * slope_map.footprint_px / slope_map.footprint if slope_map.footprint > 0 else math.inf
    if slope_map.report.scale.unit != "m" or not math.isfinite(px_per_m) or px_per_m <= 0:
        return None
    most = longest_px / px_per_m
    decade = 10.0 ** math.floor(math.log10(most))
    length = max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= most)
    return length, length * px_per_m


def scale_bar(picture: Picture, left: FloatArray, length_px: float, height: float) -> None:
    """Draw a scale bar whose middle line begins at `left` (2,): a dark half and a light one."""
    half = np.array([length_px / 2, 0.0])
    box = np.array([[0.0, -height / 2], [length_px, -height / 2], [length_px, height / 2], [0.0, height / 2]])
    marks.fill(picture, left + box, COLOURS["ink"])
    inner = np.array([[0.0, -1], [1, -1], [1, 1], [0, 1]]) * [length_px / 2 - 2, max(height / 2 - 2, 1)]
    marks.fill(picture, left + half + inner, COLOURS["paper"])


def spread(cells: NDArray[np.int16], shape: tuple[int, int], cell_px: float, beyond: int) -> NDArray[np.int16]:
    """Give every pixel of a picture the value of its cell.

    Parameters
    ----------
    cells : (rows, columns), cell (0, 0) in the corner of the picture.  cell_px : side of a cell on the picture, px.
    beyond : value of pixels without a cell.
    """
    padded = np.pad(cells, ((0, 1), (0, 1)), constant_values=beyond)
    rows, columns = (
        np.minimum(((np.arange(side) + 0.5) / cell_px).astype(int), most)
        for side, most in zip(shape, cells.shape, strict=True)
    )
    return padded[np.ix_(rows, columns)]
