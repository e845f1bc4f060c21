"""camera.png: the field of view as circles of equal angle, and what distortion does, as arrows, on the image."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.products.drawing import marks
from slopecli.products.drawing.canvas import LONG_SIDE_PX, converted, ground, text_size
from slopecli.products.drawing.lettering import Text, wrapped, write
from slopecli.products.drawing.marks import LAYOUT, Picture
from slopecli.report.camera_summary import CameraFacts, corner_shifts
from slopecli.types import Camera, FloatArray, Image

EXPLAINED = (
    "Circles: angle off the normal of the image plane. Cross: principal point. Arrows: from where a camera without "
    "distortion would show the same ray, to where it is"
)


def draw_camera(facts: CameraFacts, lines: list[str], image: Image | None = None) -> NDArray[np.uint8]:
    """Draw a camera, (h, w, 3) uint8 BGR, on its image or on grey, with the lines of its facts below."""
    camera = facts.camera
    longest = max(camera.width, camera.height)
    scale = float(np.clip(1.0, LONG_SIDE_PX["smallest map"] / longest, LONG_SIDE_PX["largest"] / longest))
    shape = max(1, round(camera.height * scale)), max(1, round(camera.width * scale)), 3
    picture = np.full(shape, 214, np.uint8) if image is None else ground(image, scale).copy()
    text_px = text_size(picture)
    _shade_without_rays(picture, camera)
    texts = _circles(picture, camera, scale, text_px)
    explained = f"{EXPLAINED}{_arrows(picture, camera, scale, text_px)}."
    centre = _place(np.array([[camera.cx, camera.cy]]), scale)[0]
    for way in (np.array([text_px, 0.0]), np.array([0.0, text_px])):
        marks.cased_stroke(picture, np.array([centre - way, centre + way]), marks.COLOURS["caution"], 2)
    texts += _corners(facts, picture.shape, text_px)
    picture = write(picture, texts)
    return converted(np.vstack([picture, _legend([explained, *lines], shape[1], text_px)]), cv2.COLOR_RGB2BGR)


def _place(uv: FloatArray, scale: float) -> FloatArray:
    return np.asarray((uv + 0.5) * scale - 0.5)


def _shade_without_rays(picture: Picture, camera: Camera) -> None:
    """Darken the parts of the image for which the lens has no ray."""
    if camera.model == "pinhole":
        return
    height, width = picture.shape[:2]
    rows, columns = max(2, height // 8), max(2, width // 8)
    u, v = np.linspace(0, camera.width - 1, columns), np.linspace(0, camera.height - 1, rows)
    rays = rays_from_pixels(camera, np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    seen = np.isfinite(rays).all(axis=1).reshape(rows, columns).astype(np.uint8)
    blind = cv2.resize(seen, (width, height), interpolation=cv2.INTER_NEAREST) == 0
    picture[blind] //= 3


def _circles(picture: Picture, camera: Camera, scale: float, text_px: int) -> list[Text]:
    """Draw circles of equal angle; returns what is written at them."""
    corners = np.array(
        [[0, 0], [camera.width - 1, 0], [camera.width - 1, camera.height - 1], [0, camera.height - 1]], float
    )
    angles = np.degrees(np.arctan(np.hypot(*rays_from_pixels(camera, corners).T)))
    widest = float(np.nanmax(angles)) if np.isfinite(angles).any() else 85.0
    step = next(step for step in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0) if widest / step <= 6 or step == 20.0)
    turn = np.linspace(0, 2 * np.pi, 361)
    texts = []
    for angle in np.arange(step, min(widest, 89.0), step):
        x = np.tan(np.radians(angle)) * np.column_stack([np.cos(turn), np.sin(turn)])
        uv = pixels_from_rays(camera, x)
        for line in np.split(uv, np.flatnonzero(~np.isfinite(uv).all(axis=1))):
            line = _place(line[np.isfinite(line).all(axis=1)], scale)
            if len(line) > 1 and np.abs(line).max() < 2 * LONG_SIDE_PX["largest"]:
                marks.cased_stroke(picture, line, marks.COLOURS["paper"], 1)
        at = _place(uv[45:46], scale)[0]  # below and to the right of the axis
        if np.isfinite(at).all() and (at > text_px).all() and (at < np.array(picture.shape[1::-1]) - 3 * text_px).all():
            texts.append(Text((float(at[0]), float(at[1])), f"{angle:g}°", text_px, "mm"))
    return texts


def _arrows(picture: Picture, camera: Camera, scale: float, text_px: int) -> str:
    """Draw the shifts by distortion at places of a grid; returns how much longer they are drawn, in words."""
    if camera.model == "pinhole":
        return ""
    columns = 12
    rows = max(2, round(columns * camera.height / camera.width))
    u, v = ((np.arange(n) + 0.5) * side / n - 0.5 for n, side in ((columns, camera.width), (rows, camera.height)))
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    shifts = corner_shifts(camera, uv) * scale
    length = np.hypot(*shifts.T)
    usual = length[np.isfinite(length) & (length < 0.5 * max(picture.shape))]
    longest = float(usual.max(initial=0.0))
    times = 10.0 ** np.ceil(np.log10(max(1.0, 2 * text_px / longest))) if longest > 0 else 1.0
    for tip, shift in zip(_place(uv, scale), shifts, strict=True):
        if np.isfinite(shift).all() and np.hypot(*shift) < 0.5 * max(picture.shape):
            marks.cased_stroke(picture, np.array([tip - times * shift, tip]), marks.COLOURS["hazard"], 2)
            marks.disc(picture, tip, 0.25 * text_px, marks.COLOURS["hazard"])
    return f" (dot), {times:g} times as long" if times > 1 else " (dot)"


def _corners(facts: CameraFacts, shape: tuple[int, ...], text_px: int) -> list[Text]:
    """What is written at the corners: the angle off the axis, and the shift by distortion."""
    height, width = shape[:2]
    gap = 0.8 * text_px
    places = ((gap, gap, "la"), (width - gap, gap, "ra"), (width - gap, height - gap, "rd"), (gap, height - gap, "ld"))
    texts = []
    for (u, v, anchor), shift, angle in zip(places, facts.corner_shift_px, facts.corner_deg, strict=True):
        said = "no ray" if shift is None or angle is None else f"{angle:.1f}°, {np.hypot(*shift):.1f} px"
        texts.append(Text((u, v), said, text_px, anchor))
    return texts


def _legend(lines: list[str], width: int, text_px: int) -> Picture:
    """A strip of text, (h, width, 3) uint8 RGB."""
    left, values, leading = text_px, 10 * text_px, 1.3 * LAYOUT["leading"] * text_px
    texts, v = [], leading
    for line in lines:
        name, gap, value = line.partition("  ")
        u = values if gap else left
        texts += [Text((left, v), name, text_px, "lm", marks.COLOURS["ink"], halo=None)] if gap else []
        for row in wrapped(value.strip() if gap else line, text_px, width - u - text_px):
            texts.append(Text((u, v), row, text_px, "lm", marks.COLOURS["ink"], halo=None))
            v += leading
    return write(np.full((round(v), width, 3), 255, np.uint8), texts)
