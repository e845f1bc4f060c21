"""plan.png: the windows of image 1 in the colours of their predicted slope sigmas."""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.options import MANY_WINDOWS
from slopecli.plan.result import Plan, PlannedWindow, sigma_text
from slopecli.products.drawing import marks
from slopecli.products.drawing.canvas import LONG_SIDE_PX, converted, text_size
from slopecli.products.drawing.colours import slope_range_colours
from slopecli.products.drawing.legend import ColourBar, Sign, banner, draw_sheet, focus_sign, swatch
from slopecli.products.drawing.lettering import SMALLEST_TEXT_PX, Label, Text, label_texts, write
from slopecli.products.drawing.marks import Picture
from slopecli.products.drawing.placement import Box, box_around, find_room
from slopecli.types import FloatArray

TICKS_DEG = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # of the bar of colours; fixed, so that plans compare
SIGNS = {"ok": "safe", "poor": "undecided", "refused": "rejected"}
MEANINGS = {"ok": "answered", "poor": "less than half of it in image 2", "refused": "no answer"}
UNITS = {"m": " m", "baseline": " baselines", "height": " of the height"}


def draw_plan(plan: Plan) -> NDArray[np.uint8]:
    """Draw a plan, (h, w, 3) uint8 BGR, with a legend below and a warning above where two answers are likely."""
    longest = max(plan.camera.width, plan.camera.height)
    scale = float(np.clip(1.0, LONG_SIDE_PX["smallest"] / longest, LONG_SIDE_PX["largest"] / longest))
    shape = round(plan.camera.height * scale), round(plan.camera.width * scale), 3
    picture = np.full(shape, (214, 214, 210), np.uint8)  # light grey: there is no image yet
    text_px = text_size(picture)
    for one in sorted(plan.windows, key=lambda window: -window.window[2] * window.window[3]):
        _draw_window(picture, one, scale, text_px)
    picture = _annotate(picture, plan, scale, text_px)
    width = picture.shape[1]
    sheets = [picture, _legend(plan, width, text_px)]
    if plan.second_answer.likely:
        warning = "Two answers are likely: a second motion will explain the pair as well. Sigmas are the right one's."
        sheets.insert(0, banner(warning, width, text_px))
    return converted(np.vstack(sheets), cv2.COLOR_RGB2BGR)


def sigma_colours(sigma_deg: FloatArray) -> NDArray[np.uint8]:
    """(n, 3) uint8 RGB of sigmas (n,), deg, by the logarithm, with the colours of slopes."""
    return slope_range_colours(_place(np.maximum(sigma_deg, 1e-9)))


def _place(sigma_deg: FloatArray | float) -> FloatArray:
    """Place of a sigma, deg, on the bar of colours: 0 at the first tick, 1 at the last, by the logarithm."""
    low, high = np.log([TICKS_DEG[0], TICKS_DEG[-1]])
    return np.asarray((np.log(sigma_deg) - low) / (high - low))


def _corners(one: PlannedWindow, scale: float) -> tuple[int, int, int, int]:
    """Left, top, right and bottom pixel of a window on the picture, the last two not its own."""
    x, y, w, h = one.window
    return round(x * scale), round(y * scale), round((x + w) * scale), round((y + h) * scale)


def _draw_window(picture: Picture, one: PlannedWindow, scale: float, text_px: int) -> None:
    left, top, right, bottom = _corners(one, scale)
    patch = picture[top:bottom, left:right]
    sigma = one.slope_sigma_deg
    patch[:] = marks.COLOURS["no answer"] if sigma is None else sigma_colours(np.array([sigma]))[0]
    outline = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * [right - left - 1.0, bottom - top - 1.0]
    line = max(1, round(min(text_px / 6, min(patch.shape[:2]) / 30)))
    marks.paint_verdict(patch, [outline], SIGNS[one.status], line)


def _annotate(picture: Picture, plan: Plan, scale: float, text_px: int) -> Picture:
    """Draw the focus of expansion and the labels clear of it and of each other."""
    taken: list[Box] = []
    if plan.epipole1_px is not None:
        focus = (np.array(plan.epipole1_px) + 0.5) * scale - 0.5
        marks.focus_mark(picture, focus, 0.75 * text_px)
        taken.append(box_around(focus, np.full(2, 2.6 * text_px)))
    texts: list[Text] = []
    many = len(plan.windows) >= MANY_WINDOWS
    for one in plan.windows:
        label, centre = _label(one, scale, taken, text_px)
        if centre is None:
            if many:  # their labels would cover each other, and the colours
                continue
            left, top, right, bottom = _corners(one, scale)
            centre = 0.5 * np.array([left + right, top + bottom]) - 0.5
        taken.append(box_around(centre, label.extent))
        texts += label_texts(label, centre)
    return write(picture, texts)


def _label(one: PlannedWindow, scale: float, taken: list[Box], text_px: int) -> tuple[Label, FloatArray | None]:
    """The label of a window, smaller where there is little room, and its centre; None where even the smallest has no
    room."""
    left, top, right, bottom = _corners(one, scale)
    room, corner = np.full((bottom - top, right - left), 255, np.uint8), np.array([left, top], float)
    middle = corner + 0.5 * np.array([right - left, bottom - top]) - 0.5
    rows = (str(one.id), "no answer" if one.slope_sigma_deg is None else f"± {sigma_text(one.slope_sigma_deg)}")
    for size in (round(1.4 * text_px), text_px, SMALLEST_TEXT_PX):
        label = Label(rows, size)
        fits = bool((label.extent <= np.array([right - left, bottom - top])).all())
        centre = find_room(room, corner, label.extent, middle, taken) if fits else None
        if centre is not None:
            return label, centre
    return label, None


def _legend(plan: Plan, width: int, text_px: int) -> Picture:
    found = {one.status for one in plan.windows}
    entries: list[tuple[str, Sign]] = [
        (meaning, partial(swatch, SIGNS[status])) for status, meaning in MEANINGS.items() if status in found
    ]
    if plan.epipole1_px is not None:
        entries.append(("focus of expansion", focus_sign))
    ticks = [(float(_place(tick)), f"{tick:g}°{'+' if tick == TICKS_DEG[-1] else ''}") for tick in TICKS_DEG]
    mark = None
    if plan.wanted is not None:
        mark = float(np.clip(_place(plan.wanted.sigma_deg), 0.0, 1.0)), f"wanted {plan.wanted.sigma_deg:g}°"
    return draw_sheet(width, text_px, _caption(plan), ColourBar(slope_range_colours, ticks, mark), entries)


def _caption(plan: Plan) -> str:
    x, y, z = plan.direction_cam1
    unit = UNITS[plan.unit]
    height = "" if plan.unit == "height" else f", height {plan.height:.3g}{unit}"
    seen = ", of what image 2 shows of it" if any(one.in_part for one in plan.windows) else ""
    return (
        f"Window: id, predicted 1 sigma of its slope{seen}. Baseline {plan.baseline:.3g}{unit}{height}, "
        f"direction {x:.3g}, {y:.3g}, {z:.3g} in camera-1 axes. {plan.points} points a window, "
        f"noise {plan.noise_px:g} px, roughness {plan.ground.roughness:g}. Median parallax {plan.parallax_px:.0f} px."
    )
