"""Patterns that mark cells of a map: the same on the picture and in its legend."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.products.drawing.marks import COLOURS, Colour, Picture, lay_colour
from slopecli.types import BoolArray, FloatArray

Cover = NDArray[np.uint8]  # how much of a pixel is covered, 0 to 255
Pattern = Callable[[Picture, BoolArray, int], None]  # draws on those pixels (h, w), with text of a size on the picture


def lay_unknown(picture: Picture, where: BoolArray, text_px: int) -> None:
    """Draw dark lines that fall to the right."""
    _lay_tiled(picture, where, _hatch_tile(0.8 * text_px, 0.05 * text_px, False), COLOURS["hatch"])


def lay_step(picture: Picture, where: BoolArray, text_px: int) -> None:
    """Draw vermilion lines that cross; they lie on a dark ground."""
    _lay_tiled(picture, where, _hatch_tile(0.7 * text_px, 0.05 * text_px, True), COLOURS["hazard"])


def lay_undecided(picture: Picture, where: BoolArray, text_px: int) -> None:
    """Draw white dots with a dark rim, which show on every class."""
    radius = 0.11 * text_px
    _lay_signs(picture, where, 0.72 * text_px, lambda u, v, rim: np.hypot(u, v) - radius - rim)


def lay_rough(picture: Picture, where: BoolArray, text_px: int) -> None:
    """Draw white crosses with a dark rim."""
    half, reach = 0.06 * text_px, 0.22 * text_px

    def outside(u: FloatArray, v: FloatArray, rim: float) -> FloatArray:
        across = np.abs(np.abs(u) - np.abs(v)) / np.sqrt(2) - half
        return np.maximum(across, np.maximum(np.abs(u), np.abs(v)) - reach) - rim

    _lay_signs(picture, where, text_px, outside)


def lay_nothing(picture: Picture, where: BoolArray, text_px: int) -> None:
    """Draw nothing: the pattern of a plain class."""


def _lay_tiled(picture: Picture, where: BoolArray, tile: Cover, colour: Colour) -> None:
    """Lay tiles, the first in the corner of the picture, and show them on some pixels."""
    if where.any():
        times = [-(-side // len(tile)) for side in where.shape]
        lay_colour(
            picture, colour, np.where(where, np.tile(tile, times)[: where.shape[0], : where.shape[1]], np.uint8(0))
        )


def _hatch_tile(period: float, half_width: float, crossed: bool) -> Cover:
    """Lines that fall to the right, and if `crossed` others that rise, one period of them."""
    side = max(4, round(period / 2) * 2)
    v, u = np.indices((side, side)).astype(float)
    away = [np.abs((u + sign * v) % side - side / 2) / np.sqrt(2) for sign in ((-1, 1) if crossed else (-1,))]
    return _cover(np.min(away, axis=0) - half_width)


def _lay_signs(
    picture: Picture, where: BoolArray, period: float, outside: Callable[[FloatArray, FloatArray, float], FloatArray]
) -> None:
    """Draw whole signs, white with a dark rim, on a staggered lattice, and at least one in every piece of ground.

    outside(u, v, rim) : signed distance, px, of points from the border of a sign at (0, 0) that is wider by a rim.
    """
    if not where.any():
        return
    places = _places(where, max(4, round(period / 2) * 2))
    reach = int(np.ceil(0.5 * period))
    v, u = np.indices((2 * reach + 1, 2 * reach + 1)) - reach
    for rim, colour in ((1.2, COLOURS["ink"]), (0.0, COLOURS["paper"])):
        stamp = _cover(outside(u.astype(float), v.astype(float), rim))
        inked = stamp > 0
        rows, columns = places[:, :1] + reach + v[inked], places[:, 1:] + reach + u[inked]
        padded = np.zeros((where.shape[0] + 2 * reach, where.shape[1] + 2 * reach), np.uint8)
        np.maximum.at(padded, (rows, columns), stamp[inked])
        lay_colour(picture, colour, padded[reach:-reach, reach:-reach])


def _places(where: BoolArray, period: int) -> NDArray[np.int64]:
    """(n, 2) row and column of every sign: on the lattice, and in the middle of connected pixels that it misses."""
    _, pieces, _, middles = cv2.connectedComponentsWithStats(where.astype(np.uint8), connectivity=8)
    lattice = np.zeros(where.shape, bool)
    lattice[period // 4 :: period, period // 4 :: period] = True
    lattice[period // 4 + period // 2 :: period, period // 4 + period // 2 :: period] = True
    marked = where & lattice
    missed = np.ones(len(middles), bool)
    missed[pieces[marked]] = missed[0] = False
    return np.vstack([np.argwhere(marked), np.rint(middles[missed, ::-1]).astype(np.int64)])


def _cover(outside: FloatArray) -> Cover:
    """Share of pixels that a shape covers, from their signed distance to its border, px."""
    return np.asarray(np.rint(255.0 * np.clip(0.5 - outside, 0.0, 1.0)), np.uint8)
