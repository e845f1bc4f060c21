"""Pictures of how image 1 was divided into planes, step by step, at the size of the overlay.

After Cheng, Fig. 12: the gradient, the connected regions that its threshold leaves, and the regions merged into planes.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.products.drawing import marks
from slopecli.products.drawing.canvas import converted, drawing_scale, resized, text_size
from slopecli.products.drawing.colours import map_colours
from slopecli.products.drawing.legend import ColourBar, draw_sheet
from slopecli.products.drawing.marks import LAYOUT, Picture
from slopecli.products.drawing.outlines import footprints_of
from slopecli.products.drawing.placement import place_numbers
from slopecli.products.overlay import draw_labels
from slopecli.types import Image, Report, Segmentation


def draw_gradient(report: Report, image: Image) -> NDArray[np.uint8]:
    """Draw the gradient magnitude of image 1, cool below the threshold and warm above it.

    Parameters
    ----------
    report : an answer with a `segmentation`.
    image : image 1.

    Returns
    -------
    (h, w, 3) uint8 BGR, as large as the overlay, with a caption below.
    """
    steps, grey = _ground(report, image)
    threshold = steps.threshold
    most = max(2.0 * threshold, float(np.percentile(steps.gradient, 99.5)))  # a few edges would darken all others
    enlarged = cv2.resize(steps.gradient, grey.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    picture = _gradient_colours(np.asarray(enlarged, np.float32), threshold, most)
    bar = ColourBar(
        lambda places: _gradient_colours((most * places).astype(np.float32), threshold, most),
        [(0.0, "0"), (1.0, f"{most:.3g}+")],
        (threshold / max(most, 1e-6), f"threshold {threshold:.3g}"),
    )
    below = "Gradient of image 1, grey levels per px. Blue, below the threshold: inside a surface."
    return _captioned(picture, f"{below} Red to yellow, above it: a border between surfaces.", bar)


def draw_components(report: Report, image: Image) -> NDArray[np.uint8]:
    """Draw the connected regions below the threshold of the gradient; arguments and result as of `draw_gradient`."""
    steps, grey = _ground(report, image)
    count = steps.components.max(initial=0)
    sentence = f"Connected regions below the threshold of the gradient: {count}. Dark: none."
    return _captioned(_tinted(steps.components, grey), sentence)


def draw_merged(report: Report, image: Image) -> NDArray[np.uint8]:
    """Draw the merged regions with the ids of the planes; arguments and result as of `draw_gradient`."""
    steps, grey = _ground(report, image)
    shape, text_px = (grey.shape[0], grey.shape[1]), text_size(grey)
    footprints = footprints_of(report, drawing_scale(report, image), shape, text_px)
    numbers = place_numbers([one for one in footprints if one.pieces is not None], shape, text_px)
    picture = draw_labels(_tinted(steps.merged, grey), numbers, text_px)
    count = f"Regions after merging: {steps.merged.max(initial=0)}"
    caption = f"{count}. Numbers: the ids of the {len(numbers)} planes of the answer. Dark: no region."
    return _captioned(picture, caption)


def _ground(report: Report, image: Image) -> tuple[Segmentation, Picture]:
    """The segmentation, and image 1 in grey at the size of the drawing, (h, w, 3) RGB."""
    if report.segmentation is None:
        raise ValueError("the planes of this report were not found by segmentation, so it has no steps")
    return report.segmentation, converted(resized(image.grey, drawing_scale(report, image)), cv2.COLOR_GRAY2RGB)


def _captioned(picture: Picture, sentence: str, bar: ColourBar | None = None) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 BGR of an RGB picture with a legend below."""
    sheet = draw_sheet(picture.shape[1], text_size(picture), sentence, bar)
    return converted(np.vstack([picture, sheet]), cv2.COLOR_RGB2BGR)


def _gradient_colours(gradient: NDArray[np.float32], threshold: float, most: float) -> Picture:
    """(..., 3) RGB of gradients: one ramp of colours up to the threshold, another from there to `most`."""
    below = _ramp(gradient / max(threshold, 1e-6), (10, 14, 30), (92, 124, 190))
    above = _ramp((gradient - threshold) / max(most - threshold, 1e-6), (190, 60, 10), (255, 236, 140))
    return np.where((gradient < threshold)[..., None], below, above)


def _ramp(share: NDArray[np.float32], dark: marks.Colour, light: marks.Colour) -> NDArray[np.uint8]:
    """(..., 3) RGB between two colours; share 0 is dark, 1 light."""
    shares = np.clip(share, 0.0, 1.0)[..., None]
    return np.rint((1.0 - shares) * np.array(dark, np.float32) + shares * np.array(light, np.float32)).astype(np.uint8)


def _tinted(regions: NDArray[np.int32], grey: Picture) -> Picture:
    """Image in grey with every region in its colour."""
    shown = cv2.resize(regions, grey.shape[1::-1], interpolation=cv2.INTER_NEAREST_EXACT)
    mixed = cv2.addWeighted(map_colours(regions)[shown], LAYOUT["tint"], grey, 1.0 - LAYOUT["tint"], 0.0)
    return np.asarray(mixed, np.uint8)
