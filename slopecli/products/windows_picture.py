"""overlay.png of many windows: image 1 in classes of slope, as a map; their ids and numbers would cover it."""

from __future__ import annotations

from collections import Counter

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.products.drawing.canvas import converted, map_frame, resized
from slopecli.products.drawing.classes import UNKNOWN, classes_of
from slopecli.products.drawing.ground_marks import draw_tolerance_edge
from slopecli.products.drawing.legend import UP_WORDS, draw_banner
from slopecli.products.drawing.patterns import lay_undecided
from slopecli.products.map_legend import draw_map_legend, windows_entries
from slopecli.products.map_picture import painted
from slopecli.types import Image, Report


def draw_windows(report: Report, image: Image) -> NDArray[np.uint8]:
    """Draw the slopes of windows over image 1, with a legend below and, if the answer is ambiguous, a banner above.

    Returns (h, w, 3) uint8 BGR; higher than the image in its `map_frame` by legend and banners.
    """
    frame, tolerance = map_frame(image), float(report.options["tolerance_deg"])
    classes = classes_of(report)
    told = [plane for plane in report.planes if plane.slope_known and plane.status == "ok"]
    asked = sorted([plane.id for plane in report.planes] + [one.id for one in report.rejected])
    cells = np.full(asked[-1] + 1, UNKNOWN, np.int16)
    cells[[plane.id for plane in told]] = classes.of([plane.slope_deg for plane in told])
    undecided = np.zeros(len(cells), bool)
    undecided[[plane.id for plane in told if plane.verdict == "undecided"]] = True

    labels = _labels(report, (image.height, image.width))
    labels = np.asarray(cv2.resize(labels, (frame.width, frame.height), interpolation=cv2.INTER_NEAREST), np.uint16)
    shown = cells[labels]
    picture = painted(image, frame, shown, classes)
    lay_undecided(picture, undecided[labels], frame.text_px)
    draw_tolerance_edge(picture, shown >= (classes.steep_from or 0), shown >= 0, 1.0, frame.text_px)
    outside = labels == 0
    picture[outside] = resized(image.grey, frame.scale)[outside, None]

    entries = windows_entries(cells[asked], undecided[asked], classes, tolerance, frame.text_px)
    legend = draw_map_legend(None, f"Slope of {len(asked)} windows", entries, _caption(report, len(asked)), frame)
    sheets = [*draw_banner(report, frame.width, frame.text_px), picture, legend]
    return converted(np.vstack(sheets), cv2.COLOR_RGB2BGR)


def _labels(report: Report, shape: tuple[int, int]) -> NDArray[np.uint16]:
    """(h, w) the id of every pixel's window, those without an answer included; 0 outside all."""
    labels = np.zeros(shape, np.uint16)
    outlines = {one.id: one.polygon_px for one in report.rejected} | {one.id: one.polygon_px for one in report.planes}
    for number, polygon in outlines.items():
        (left, top), (right, bottom) = (polygon[[0, 2]] + 0.5).astype(int).tolist()
        labels[top:bottom, left:right] = number
    return labels


def _caption(report: Report, n: int) -> str:
    """What the picture shows, in sentences."""
    counts = Counter(plane.verdict or "taken as level" for plane in report.planes)
    unknown = n - sum(plane.slope_known and plane.status == "ok" for plane in report.planes)
    verdicts = "; ".join(f"{name} {counts[name]}" for name in ("safe", "unsafe", "undecided") if counts[name])
    return (
        f"Of the windows: {verdicts or 'no verdict'}. Slope of the plane of every window, against "
        f"{UP_WORDS[report.up.source]}. Percentages are of the windows. Hatched: the {unknown} windows without a sure "
        "plane of their own; nobody knows whether they are safe. slopes.json has the numbers of all."
    )
