"""Map pixels of any depth to 8-bit grey and colour."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopecli.errors import InputError

TAIL_PERCENT = 0.1  # share of the pixels that may saturate at either end, however close to the others their values are
BULK_PERCENT = 5.0  # below and above the values that are the bulk of an image
BEYOND = 2.0  # how far the range may reach beyond the bulk, in widths of the bulk: of Gaussian values nothing is cut
SAMPLE_SIDE = 1024  # about the rows and columns from which percentiles are estimated


def to_8_bit(
    pixels: NDArray[Any], nodata: float | None = None
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None, str]:
    """Grey, colour (None for one channel) and a note on the mapping of the values ("" for 8-bit pixels).

    Parameters
    ----------
    pixels : (h, w) or (h, w, 3 or 4) array; the fourth channel is dropped.
    nodata : value of pixels without a measurement; they become 0 and do not count for the range.

    Raises
    ------
    InputError : another number of channels, or no finite value. The message does not name the file.
    """
    import cv2

    if pixels.ndim == 3 and pixels.shape[2] not in (3, 4):
        raise InputError(f"has {pixels.shape[2]} channels, needed 1 (grey), 3 (colour) or 4 (with alpha)")
    if pixels.dtype not in (np.uint8, np.uint16, np.float32):  # the types that OpenCV converts to grey
        with np.errstate(over="ignore"):  # of float64 values beyond float32, which become infinite
            pixels = pixels.astype(np.float32)
    grey: NDArray[Any] = pixels
    colour: NDArray[Any] | None = None
    if pixels.ndim == 3:
        alpha = pixels.shape[2] == 4
        grey = cv2.cvtColor(pixels, cv2.COLOR_BGRA2GRAY if alpha else cv2.COLOR_BGR2GRAY)
        colour = cv2.cvtColor(pixels, cv2.COLOR_BGRA2BGR) if alpha else pixels
    if pixels.dtype == np.uint8:
        return grey, colour, ""
    empty = None if nodata is None else _is_nodata(pixels, nodata)
    low, high, share = _range(grey, empty)
    note = f"{pixels.dtype} values {low:.6g} to {high:.6g} mapped to 0..255"
    if share > 4 * TAIL_PERCENT / 100:  # more than the two tails and some noise
        note += f", {100 * share:.2g} % of the pixels are outside"
    colour = None if colour is None else _map(colour, low, high, empty)
    return _map(grey, low, high, empty), colour, note


def _is_nodata(pixels: NDArray[Any], nodata: float) -> NDArray[np.bool_]:
    """(h, w): whether all colours of a pixel have the nodata value, as rounded to the type of the pixels."""
    with np.errstate(over="ignore"):
        value = np.float32(nodata) if pixels.dtype == np.float32 else nodata
    same = pixels == value
    return np.asarray(same if same.ndim == 2 else same[..., :3].all(axis=2))


def _range(grey: NDArray[Any], empty: NDArray[np.bool_] | None) -> tuple[float, float, float]:
    """The values mapped to 0 and 255, and the share of measured pixels outside.

    They are percentiles near the extremes, but no farther from the bulk of the values than `BEYOND` of its width, as
    glints and dead pixels may be. The least and the greatest value that occur do not count, unless there are few
    others: where pixels are saturated or have no measurement, this is what they hold.
    """
    step = [max(1, side // SAMPLE_SIDE) for side in grey.shape]
    sample = np.s_[:: step[0], :: step[1]]
    measured = grey[sample].astype(np.float64)
    measured = measured[np.isfinite(measured)] if empty is None else measured[np.isfinite(measured) & ~empty[sample]]
    if not len(measured):
        raise InputError("has no finite pixel value; export it again")
    least, greatest = measured.min(), measured.max()
    values = measured[(measured > least) & (measured < greatest)]
    if len(values) < BULK_PERCENT / 100 * len(measured):
        values = measured
    percents = [TAIL_PERCENT, BULK_PERCENT, 100 - BULK_PERCENT, 100 - TAIL_PERCENT]
    low, first, last, high = np.percentile(values, percents)
    low, high = max(low, first - BEYOND * (last - first)), min(high, last + BEYOND * (last - first))
    if low >= high:
        low, high = least, greatest
    if grey.dtype == np.uint16:  # bounds of the same type as the pixels
        low, high = np.floor(low), np.ceil(high)
    return float(low), float(high), float(np.mean((measured < low) | (measured > high)))


def _map(values: NDArray[Any], low: float, high: float, empty: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    import cv2

    scale = 255.0 / (high - low) if high > low else 0.0
    if values.dtype == np.float32:
        values = np.nan_to_num(values, nan=low, posinf=high, neginf=low)
    clipped = np.clip(values, values.dtype.type(low), values.dtype.type(high))
    mapped = np.asarray(cv2.convertScaleAbs(clipped, alpha=scale, beta=-low * scale), dtype=np.uint8)
    if empty is not None:
        mapped[empty] = 0
    return mapped
