"""Pictures of how image 1 was divided into planes, step by step, at the size of the overlay.

After Cheng, Fig. 12: the gradient, the connected regions that its threshold leaves, and the regions merged into planes.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.products.drawing import marks
from slopecli.products.drawing.canvas import converted, drawing_scale, resized, text_size
from slopecli.products.drawing.lettering import LEADING, Text, text_width, wrapped, write
from slopecli.products.drawing.map_palette import map_colours
from slopecli.products.drawing.marks import Picture
from slopecli.products.drawing.outlines import footprints_of
from slopecli.products.drawing.png import encode_picture
from slopecli.products.drawing.region_numbers import place_numbers
from slopecli.products.overlay import draw_labels
from slopecli.segmentation import Segmentation
from slopecli.types import Image, Report

BRIGHTEST = 99.5  # percentile of the gradient that is shown brightest: a few edges would leave the others dark
TINT = 0.65  # share of a region's colour; the rest keeps the image recognisable
# colours of the gradient, dark to light, below the threshold and above it
INSIDE: tuple[marks.Colour, marks.Colour] = ((10, 14, 30), (92, 124, 190))
BETWEEN: tuple[marks.Colour, marks.Colour] = ((190, 60, 10), (255, 236, 140))
TINY = 1e-6  # grey levels per px: stands for a threshold of 0 in a quotient
_TONES = 128


def encode_gradient(report: Report, image: Image) -> bytes:
    """Return the content of step1_gradient.png."""
    return encode_picture(draw_gradient(report, image))


def encode_components(report: Report, image: Image) -> bytes:
    """Return the content of step2_components.png."""
    return encode_picture(draw_components(report, image))


def encode_merged(report: Report, image: Image) -> bytes:
    """Return the content of step3_merged.png."""
    return encode_picture(draw_merged(report, image))


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
    steps, grey, text_px = _ground(report, image)
    threshold = steps.threshold
    most = max(2.0 * threshold, float(np.percentile(steps.gradient, BRIGHTEST)))
    enlarged = cv2.resize(steps.gradient, grey.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    picture = _gradient_colours(np.asarray(enlarged, np.float32), threshold, most)
    bar = _bar(grey.shape[1], text_px, threshold, most)
    sentence = (
        "Gradient of image 1, grey levels per px. Blue, below the threshold: inside a surface. "
        "Red to yellow, above it: a border between surfaces."
    )
    return _finished([picture, bar], text_px, sentence)


def draw_components(report: Report, image: Image) -> NDArray[np.uint8]:
    """Draw the connected regions below the threshold of the gradient; arguments and result as of `draw_gradient`."""
    steps, grey, text_px = _ground(report, image)
    count = steps.components.max(initial=0)
    sentence = f"Connected regions below the threshold of the gradient: {count}. Dark: none."
    return _finished([_tinted(steps.components, grey)], text_px, sentence)


def draw_merged(report: Report, image: Image) -> NDArray[np.uint8]:
    """Draw the merged regions with the ids of the planes; arguments and result as of `draw_gradient`."""
    steps, grey, text_px = _ground(report, image)
    shape = grey.shape[0], grey.shape[1]
    footprints = footprints_of(report, drawing_scale(report, image), shape, text_px)
    numbers = place_numbers([one for one in footprints if one.pieces is not None], shape, text_px)
    picture = draw_labels(_tinted(steps.merged, grey), numbers, text_px)
    count = f"Regions after merging: {steps.merged.max(initial=0)}"
    sentence = f"{count}. Numbers: the ids of the {len(numbers)} planes of the answer. Dark: no region."
    return _finished([picture], text_px, sentence)


def _ground(report: Report, image: Image) -> tuple[Segmentation, Picture, int]:
    """The segmentation, image 1 in grey at the size of the drawing (h, w, 3) RGB, and the size of text on it, px."""
    if report.segmentation is None:
        raise ValueError("the planes of this report were not found by segmentation, so it has no steps")
    grey = converted(resized(image.grey, drawing_scale(report, image)), cv2.COLOR_GRAY2RGB)
    return report.segmentation, grey, text_size(grey)


def _finished(sheets: Sequence[Picture], text_px: int, sentence: str) -> NDArray[np.uint8]:
    """(h, w, 3) uint8 BGR of RGB sheets, one below the other, and a caption."""
    sheets = [*sheets, _caption(sheets[0].shape[1], text_px, sentence)]
    return converted(np.vstack(sheets), cv2.COLOR_RGB2BGR)


def _gradient_colours(gradient: NDArray[np.float32], threshold: float, most: float) -> Picture:
    """(h, w, 3) RGB of a gradient (h, w): one ramp up to the threshold, another from there to `most`."""
    tones = np.concatenate([_ramp(*INSIDE), _ramp(*BETWEEN)])
    below, above = gradient / max(threshold, TINY), (gradient - threshold) / max(most - threshold, TINY)
    level = np.where(gradient < threshold, below, 1.0 + above) * (_TONES - 1)
    level = np.clip(level, 0, 2 * _TONES - 1)
    return np.asarray(tones[np.rint(level).astype(np.int32)], np.uint8)


def _ramp(dark: marks.Colour, light: marks.Colour) -> NDArray[np.uint8]:
    """(_TONES, 3) RGB from one colour to another."""
    share = np.linspace(0.0, 1.0, _TONES)[:, None]
    return np.rint((1.0 - share) * np.array(dark) + share * np.array(light)).astype(np.uint8)


def _bar(width: int, text_px: int, threshold: float, most: float) -> Picture:
    """Strip with the colours of the gradient from 0 to `most`, and a mark at the threshold."""
    sheet = np.full((4 * text_px, width, 3), marks.PAPER, np.uint8)
    left, right, top, bottom = text_px, min(width - 2 * text_px, 36 * text_px), 2 * text_px, 3 * text_px
    values = np.linspace(0.0, most, right - left, dtype=np.float32)
    sheet[top:bottom, left:right] = _gradient_colours(values[None], threshold, most)
    u = left + threshold / max(most, TINY) * (right - left)
    marks.cased_stroke(sheet, np.array([[u, top - 2.0], [u, bottom + 2.0]]), marks.PAPER, 2)
    notes = [(u, top - 0.7 * text_px, f"threshold {threshold:.3g}"), (left, bottom + 0.6 * text_px, "0")]
    notes.append((right, bottom + 0.6 * text_px, f"{most:.3g}+"))
    middle = 0.5 * text_width(notes[0][2], text_px)
    placed = [(float(np.clip(at, middle if i == 0 else 0.0, width)), v, text) for i, (at, v, text) in enumerate(notes)]
    return write(sheet, [Text((at, v), text, text_px, "mm", marks.INK, None) for at, v, text in placed])


def _tinted(regions: NDArray[np.int32], grey: Picture) -> Picture:
    """Image in grey with every region in its colour."""
    shown = cv2.resize(regions, grey.shape[1::-1], interpolation=cv2.INTER_NEAREST_EXACT)
    mixed = cv2.addWeighted(map_colours(regions)[shown], TINT, grey, 1.0 - TINT, 0.0)
    return np.asarray(mixed, np.uint8)


def _caption(width: int, text_px: int, sentence: str) -> Picture:
    """Strip of paper with a sentence on it."""
    lines = wrapped(sentence, text_px, width - 2 * text_px)
    rows = (1.0 + LEADING * np.arange(len(lines))) * text_px
    sheet = np.full((round(float(rows[-1]) + text_px), width, 3), marks.PAPER, np.uint8)
    texts = [
        Text((text_px, float(v)), line, text_px, "lm", marks.INK, None) for v, line in zip(rows, lines, strict=True)
    ]
    return write(sheet, texts)
