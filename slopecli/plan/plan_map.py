"""plan.png: image 1 as it will be, its windows coloured by how well a pair will tell their slopes."""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.plan import Plan, PlannedWindow, sigma_text
from slopecli.products.drawing import marks
from slopecli.products.drawing.canvas import LARGEST_PX, SMALLEST_PX, converted, text_size
from slopecli.products.drawing.colormap import SLOPE_RANGE_DEG, slope_colours
from slopecli.products.drawing.legend import Strip, banner, focus_sign, swatch
from slopecli.products.drawing.lettering import (
    LEADING,
    Box,
    Label,
    Text,
    box_around,
    find_room,
    label_texts,
    wrapped,
    write,
)
from slopecli.products.drawing.marks import Picture
from slopecli.types import FloatArray

SIGMA_RANGE_DEG = (0.03, 10.0)  # logarithmic and fixed, so that plans compare
TICKS_DEG = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
GROUND = (214, 214, 210)  # there is no image yet
SMALLEST_TEXT_PX = 9
SIGNS = {"ok": "safe", "poor": "undecided", "refused": "rejected"}
MEANINGS = {"ok": "answered", "poor": "less than half of it in image 2", "refused": "no answer"}
UNITS = {"m": " m", "baseline": " baselines", "height": " of the height"}


def draw_plan(plan: Plan) -> NDArray[np.uint8]:
    """Draw a plan, (h, w, 3) uint8 BGR, with a legend below and a warning above where two answers are likely."""
    scale = _scale(plan)
    picture = np.full((round(plan.camera.height * scale), round(plan.camera.width * scale), 3), GROUND, np.uint8)
    text_px = text_size(picture)
    for one in sorted(plan.windows, key=lambda window: -window.window[2] * window.window[3]):
        _draw_window(picture, one, scale, text_px)
    picture = _annotate(picture, plan, scale, text_px)
    width = picture.shape[1]
    sheets = [picture, _legend(plan, width, text_px)]
    if plan.second_answer.likely:
        sheets.insert(
            0,
            banner(
                "Two answers are likely: a second motion will explain the pair as well. Sigmas are the right one's.",
                width,
                text_px,
            ),
        )
    return converted(np.vstack(sheets), cv2.COLOR_RGB2BGR)


def sigma_colours(sigma_deg: FloatArray) -> NDArray[np.uint8]:
    """(n, 3) uint8 RGB of sigmas (n,), deg, by the logarithm, with the colours of slopes."""
    low, high = np.log(SIGMA_RANGE_DEG)
    fraction = (np.log(np.maximum(sigma_deg, 1e-9)) - low) / (high - low)
    return slope_colours(SLOPE_RANGE_DEG[0] + fraction * (SLOPE_RANGE_DEG[1] - SLOPE_RANGE_DEG[0]))


def _scale(plan: Plan) -> float:
    longest = max(plan.camera.width, plan.camera.height)
    return float(np.clip(1.0, SMALLEST_PX / longest, LARGEST_PX / longest))


def _corners(one: PlannedWindow, scale: float) -> tuple[int, int, int, int]:
    """Left, top, right and bottom pixel of a window on the picture, the last two not its own."""
    x, y, w, h = one.window
    return round(x * scale), round(y * scale), round((x + w) * scale), round((y + h) * scale)


def _draw_window(picture: Picture, one: PlannedWindow, scale: float, text_px: int) -> None:
    left, top, right, bottom = _corners(one, scale)
    patch = picture[top:bottom, left:right]
    sigma = one.slope_sigma_deg
    patch[:] = marks.NO_ANSWER if sigma is None else sigma_colours(np.array([sigma]))[0]
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
    for one in plan.windows:
        label, centre = _label(one, scale, taken, text_px)
        taken.append(box_around(centre, label.extent))
        texts += label_texts(label, centre)
    return write(picture, texts)


def _label(one: PlannedWindow, scale: float, taken: list[Box], text_px: int) -> tuple[Label, FloatArray]:
    """The label of a window, smaller where there is little room, and its centre."""
    left, top, right, bottom = _corners(one, scale)
    room, corner = np.full((bottom - top, right - left), 255, np.uint8), np.array([left, top], float)
    middle = corner + 0.5 * np.array([right - left, bottom - top]) - 0.5
    rows = (str(one.id), "no answer" if one.slope_sigma_deg is None else f"± {sigma_text(one.slope_sigma_deg)}")
    for size in (round(1.4 * text_px), text_px, SMALLEST_TEXT_PX):
        label = Label(rows, size)
        centre = find_room(room, corner, label.extent, middle, taken)
        if centre is not None:
            return label, centre
    return label, middle


def _legend(plan: Plan, width: int, text_px: int) -> Picture:
    strip = Strip(width, max(11, round(0.87 * text_px)))
    bar_v, bar_height = 2.3 * strip.size, 1.1 * strip.size
    strip.start(bar_v + bar_height + 3.1 * strip.size)
    found = {one.status for one in plan.windows}
    for status, sign in SIGNS.items():
        if status in found:
            strip.add(MEANINGS[status], partial(swatch, sign))
    if plan.epipole1_px is not None:
        strip.add("focus of expansion", focus_sign)
    strip.start(strip.v + strip.row)
    for line in wrapped(_caption(plan), strip.size, width - 2 * strip.size):
        strip.note(line, strip.size)
        strip.v += LEADING * strip.size
    sheet = strip.sheet(strip.v + 0.3 * strip.size)
    _draw_bar(sheet, strip, bar_v, bar_height, plan)
    for draw, centre in strip.signs:
        draw(sheet, centre, 0.55 * strip.size)
    return write(sheet, strip.texts)


def _caption(plan: Plan) -> str:
    x, y, z = plan.direction_cam1
    unit = UNITS[plan.unit]
    lengths = f"baseline {plan.baseline:.3g}{unit}" + (
        "" if plan.unit == "height" else f", height {plan.height:.3g}{unit}"
    )
    seen = ", of what image 2 shows of it" if any(one.in_part for one in plan.windows) else ""
    return (
        f"Window: id, predicted 1 sigma of its slope{seen}. {lengths[0].upper()}{lengths[1:]}, "
        f"direction {x:.3g}, {y:.3g}, {z:.3g} in camera-1 axes. {plan.points} points a window, "
        f"noise {plan.noise_px:g} px, roughness {plan.ground.roughness:g}. Median parallax {plan.parallax_px:.0f} px."
    )


def _draw_bar(sheet: Picture, strip: Strip, top: float, height: float, plan: Plan) -> None:
    """Colour bar with its ticks, and the sigma that was wanted marked on it."""
    left, right = 2.2 * strip.size, min(strip.width - 2.2 * strip.size, 36.0 * strip.size)
    low, high = np.log(SIGMA_RANGE_DEG)
    columns = np.arange(round(left), round(right))
    sigmas = np.exp(low + (columns - left) / (right - left) * (high - low))
    sheet[round(top) : round(top + height), columns] = sigma_colours(sigmas)
    for tick in TICKS_DEG:
        u = left + (np.log(tick) - low) / (high - low) * (right - left)
        marks.stroke(sheet, np.array([[u, top + height], [u, top + height + 0.35 * strip.size]]), marks.INK, 1)
        more = "+" if tick == TICKS_DEG[-1] else ""
        strip.texts.append(_bar_text(f"{tick:g}°{more}", u, top + height + 1.1 * strip.size, strip))
    if plan.wanted is not None:
        _mark_wanted(sheet, strip, top, height, plan.wanted.sigma_deg, (left, right))


def _mark_wanted(
    sheet: Picture, strip: Strip, top: float, height: float, sigma_deg: float, ends: tuple[float, float]
) -> None:
    low, high = np.log(SIGMA_RANGE_DEG)
    fraction = float(np.clip((np.log(sigma_deg) - low) / (high - low), 0.0, 1.0))
    u = ends[0] + fraction * (ends[1] - ends[0])
    marks.cased_stroke(sheet, np.array([[u, top - 2], [u, top + height + 2]]), marks.PAPER, 2)
    margin = 4.5 * strip.size
    strip.texts.append(
        _bar_text(f"wanted {sigma_deg:g}°", float(np.clip(u, margin, strip.width - margin)), top - strip.size, strip)
    )


def _bar_text(text: str, u: float, v: float, strip: Strip) -> Text:
    return Text((u, v), text, strip.size, "mm", marks.INK, halo=None)
