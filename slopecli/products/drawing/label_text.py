"""What the label of a patch says: id, slope, sigma and verdict, in several lengths."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from slopecli.products.drawing.lettering import Label
from slopecli.products.drawing.outlines import Footprint
from slopecli.types import AlternativePlane, Plane, Rejected

LARGEST, SMALLEST = 1.4, 0.62  # sizes of labels over that of the picture's text
SMALLEST_TEXT_PX = 9  # legible
UNKNOWN = "?"  # in place of a slope that is not known


def slope_text(plane: Plane) -> tuple[str, str]:
    """Return slope and sigma as "12.3°" and "± 0.4°"; "?" for a slope that is not known, "" for such a sigma."""
    sigma = plane.slope_sigma_deg
    if not math.isfinite(sigma):
        return f"{plane.slope_deg:.1f}°", ""
    digits = 0 if sigma >= 9.95 else 1 if sigma >= 0.095 else 2
    slope = f"{plane.slope_deg:.{min(digits, 1)}f}°" if plane.slope_known else UNKNOWN
    return slope, "± <0.01°" if 0 < sigma < 0.005 else f"± {sigma:.{digits}f}°"


def full_labels(footprint: Footprint, text_px: int) -> list[Label]:
    """Return labels with all that is known of a patch: large, small and, for a wide patch, in narrow rows."""
    size, name = round(np.clip(footprint.size / 14, text_px, LARGEST * text_px)), str(footprint.item.id)
    small = max(SMALLEST_TEXT_PX, round(0.8 * text_px))
    if isinstance(footprint.item, Rejected):
        full = Label((name, footprint.item.reason), size, "rejected")
        return [full, replace(full, size=small)]
    slope, sigma = slope_text(footprint.item)
    if slope == UNKNOWN:
        full = Label((f"{name} {UNKNOWN}", sigma), size, footprint.badge)
        return [full, replace(full, size=small)]
    other = footprint.other
    notes = [] if other is None else [f"or {other.slope_deg:.1f}°" if other.slope_known else f"or {UNKNOWN}"]
    notes += ["poor"] if footprint.item.status == "poor" else []
    full = Label((name, f"{slope} {sigma}".strip(), *notes), size, footprint.badge)
    labels = [full, replace(full, size=small)]
    if sigma and footprint.size >= 6 * text_px:  # more rows would crowd a smaller patch
        labels.append(replace(full, rows=(name, slope, sigma, *notes), size=small))
    return labels


def tiny_label(footprint: Footprint, text_px: int) -> Label:
    """Return the label of a patch without room: id, whole degrees if it has a slope, and badge."""
    item = footprint.item
    second = (_degrees(item, footprint.other),) if isinstance(item, Plane) else ()
    return Label((str(item.id), *second), _tiny(text_px), footprint.badge)


def shorter_labels(footprint: Footprint, text_px: int) -> Iterator[list[Label]]:
    """Yield labels with ever less than `full_labels`: id and whole degrees with and without badge, then the id."""
    item = footprint.item
    if isinstance(item, Plane):
        slope = _degrees(item, footprint.other)
        for badge in (footprint.badge, None):
            rows = ((str(item.id), slope), (f"{item.id}: {slope}",))
            yield [Label(one, _tiny(text_px), badge) for one in rows]
    yield [number_label(footprint, text_px)]


def number_label(footprint: Footprint, text_px: int) -> Label:
    """Return the smallest label: the id."""
    return Label((str(footprint.item.id),), _tiny(text_px))


def _tiny(text_px: int) -> int:
    return max(SMALLEST_TEXT_PX, round(SMALLEST * text_px))


def _degrees(plane: Plane, other: AlternativePlane | None) -> str:
    """Slope in whole degrees; both slopes where a second root is left."""
    both = (plane,) if other is None else (plane, other)
    return " or ".join(f"{one.slope_deg:.0f}°" if one.slope_known else UNKNOWN for one in both)
