"""map.png and map_sigma.png: image 1 in grey under classes of slope, or of its 1-sigma, with sites and a legend."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.ground.slope_map import SlopeMap
from slopecli.products.drawing.canvas import Frame, converted, map_frame, resized
from slopecli.products.drawing.classes import (
    STEP,
    STEP_COLOUR,
    UNKNOWN,
    Classes,
    cell_classes,
    sigma_classes,
    slope_classes,
)
from slopecli.products.drawing.ground_marks import draw_sites, draw_tolerance_edge, spread
from slopecli.products.drawing.marks import COLOURS, Picture
from slopecli.products.drawing.patterns import lay_rough, lay_step, lay_undecided, lay_unknown
from slopecli.products.map_legend import (
    Cells,
    Entry,
    draw_map_legend,
    draw_warnings,
    rough_cells,
    sigma_caption,
    sigma_entries,
    slope_caption,
    slope_entries,
    undecided_cells,
)
from slopecli.types import Image


def draw_map(slope_map: SlopeMap, image: Image) -> NDArray[np.uint8]:
    """Draw the slopes over image 1, the edge at the tolerance and landing sites; a legend below, warnings above.

    A class has the mean colour of its swatch in the legend: the image only makes it lighter and darker by its detail.

    Parameters
    ----------
    image : image 1.

    Returns
    -------
    (h, w, 3) uint8 BGR; higher than the image in its `map_frame` by legend and warnings.
    """
    frame, classes = map_frame(image), slope_classes(slope_map)
    cells = cell_classes(slope_map, classes)
    shown = _pixels(cells, frame, slope_map.spacing_px, UNKNOWN)
    picture = painted(image, frame, shown, classes)
    for where, lay_pattern in (
        (undecided_cells(slope_map, cells), lay_undecided),
        (rough_cells(slope_map, classes, cells), lay_rough),
    ):
        lay_pattern(picture, _pixels(where.astype(np.int16), frame, slope_map.spacing_px, 0) > 0, frame.text_px)
    steep = shown >= (classes.steep_from or len(classes.colours))
    draw_tolerance_edge(picture, steep, shown >= 0, slope_map.spacing_px * frame.scale, frame.text_px)
    groups = slope_entries(slope_map, classes, cells, frame.text_px)
    return _finished(
        slope_map, picture, frame, "Slope of the ground, and where to land", groups, slope_caption(slope_map)
    )


def draw_sigma(slope_map: SlopeMap, image: Image) -> NDArray[np.uint8]:
    """Draw 1-sigma of the slopes over image 1 with landing sites; arguments and result as of `draw_map`."""
    frame, classes = map_frame(image), sigma_classes()
    cells = classes.of(np.where(slope_map.known, slope_map.sigma_deg, np.nan))
    picture = painted(image, frame, _pixels(cells, frame, slope_map.spacing_px, UNKNOWN), classes)
    groups = sigma_entries(slope_map, classes, cells, frame.text_px)
    return _finished(slope_map, picture, frame, "Uncertainty of the slope, 1-sigma", groups, sigma_caption(slope_map))


def _finished(
    slope_map: SlopeMap, picture: Picture, frame: Frame, title: str, groups: Sequence[Sequence[Entry]], caption: str
) -> NDArray[np.uint8]:
    """(h, w, 3) BGR: a painted picture with its sites, a legend below and warnings above."""
    draw_sites(picture, slope_map.sites, frame)
    legend = draw_map_legend(slope_map, title, groups, caption, frame)
    return converted(np.vstack([*draw_warnings(slope_map, frame), picture, legend]), cv2.COLOR_RGB2BGR)


def painted(image: Image, frame: Frame, shown: NDArray[np.int16], classes: Classes) -> Picture:
    """Return the image in the colours of classes, (h, w, 3) RGB; shown (h, w): the class of every pixel."""
    grey = resized(image.grey, frame.scale)
    side = round(0.04 * max(grey.shape)) // 2 * 2 + 1  # of the square whose mean grey the image is compared with
    detail = 0.5 * cv2.subtract(grey, cv2.blur(grey, (side, side)), dtype=cv2.CV_32F)
    relief = np.clip(np.rint(detail), -24, 24).astype(np.int16)  # grey levels: less than half a step between classes
    picture = np.asarray(cv2.add(_coloured(shown, classes), cv2.merge([relief] * 3), dtype=cv2.CV_8U), np.uint8)
    unknown = shown == UNKNOWN
    pale = np.rint(0.55 * np.arange(256) + 0.45 * COLOURS["no answer"][0]).astype(np.uint8)  # mixed with light grey
    picture[unknown] = pale[grey[unknown]][:, None]
    lay_unknown(picture, unknown, frame.text_px)
    lay_step(picture, shown == STEP, frame.text_px)
    return picture


def _coloured(shown: NDArray[np.int16], classes: Classes) -> Picture:
    """(h, w, 3) RGB of classes and steps."""
    table = np.zeros((256, 1, 3), np.uint8)
    table[: len(classes.colours), 0] = classes.colours
    table[STEP, 0] = STEP_COLOUR  # counted from the end, as it is negative
    return np.asarray(cv2.LUT(cv2.merge([(shown % 256).astype(np.uint8)] * 3), table), np.uint8)


def _pixels(cells: Cells, frame: Frame, spacing_px: int, beyond: int) -> NDArray[np.int16]:
    """(h, w) the value of the cell of every pixel, `beyond` where there is none."""
    return spread(cells, (frame.height, frame.width), spacing_px * frame.scale, beyond)
