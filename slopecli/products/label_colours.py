"""labels_colour.png: the planes of labels.png in colours, for the eye; ids of 16 bits look black."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from slopecli.products.drawing.colours import map_colours
from slopecli.types import Image, Report


def draw_labels_colour(report: Report, image: Image) -> NDArray[np.uint8]:
    """Return (h, w, 3) uint8 BGR of the size of image 1: a colour a plane, dark for none."""
    blue_first = map_colours(report.labels.astype(np.int32))[:, ::-1]
    return np.take(blue_first, report.labels, axis=0)  # a quarter of the time of an index
