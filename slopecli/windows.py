"""Windows of image 1: rectangles whose slope is asked for."""

from __future__ import annotations

import numpy as np

from slopecli.errors import InputError
from slopecli.options import MIN_SIDE_PX
from slopecli.types import BoolArray, FloatArray

Window = tuple[int, int, int, int]  # x, y, width, height in px of image 1


def grid_windows(columns: int, rows: int, width: int, height: int) -> list[Window]:
    """The image (px) divided evenly, row by row from the top left. InputError if a cell would be too small."""
    if columns * MIN_SIDE_PX > width or rows * MIN_SIDE_PX > height:
        raise InputError(
            f"a grid of {columns}x{rows} windows does not fit into image 1, which is {width}x{height} px: they need at "
            f"least {MIN_SIDE_PX}x{MIN_SIDE_PX} px each; use at most {width // MIN_SIDE_PX}x{height // MIN_SIDE_PX}"
        )
    xs = [round(i * width / columns) for i in range(columns + 1)]
    ys = [round(j * height / rows) for j in range(rows + 1)]
    return [(xs[i], ys[j], xs[i + 1] - xs[i], ys[j + 1] - ys[j]) for j in range(rows) for i in range(columns)]


def check_windows(windows: list[Window], width: int, height: int) -> None:
    """Raise InputError for the first window that is too small or not inside image 1."""
    for number, (x, y, w, h) in enumerate(windows, 1):
        if w < MIN_SIDE_PX or h < MIN_SIDE_PX:
            raise InputError(
                f"window {number} is {w}x{h} px, at least {MIN_SIDE_PX}x{MIN_SIDE_PX} are needed; "
                "use larger windows, or a grid with fewer cells"
            )
        if x < 0 or y < 0 or x + w > width or y + h > height:
            raise InputError(
                f"window {number} ({x},{y},{w},{h}) is not inside image 1, which is {width}x{height} px; "
                f"keep 0 <= X, X+W <= {width} and 0 <= Y, Y+H <= {height}"
            )


def inside_window(uv: FloatArray, window: Window) -> BoolArray:
    """(n,) pixels (n, 2) within the window's outline."""
    x, y, w, h = window
    u, v = uv.T
    return np.asarray((u >= x - 0.5) & (u < x + w - 0.5) & (v >= y - 0.5) & (v < y + h - 0.5))


def window_polygon(window: Window) -> FloatArray:
    """Corners (4, 2) px of the window's outline, pixel edges at half integers."""
    corner = np.array(window[:2]) - 0.5
    return box_polygon(corner, corner + window[2:])


def box_polygon(low: FloatArray, high: FloatArray) -> FloatArray:
    """Corners (4, 2) of an upright rectangle between two of its corners (2,), from the top left on."""
    (left, top), (right, bottom) = low, high
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
