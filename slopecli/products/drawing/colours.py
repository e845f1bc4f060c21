"""Colours of slopes, in one fixed range for all files, and of a map of regions, where neighbours differ."""

from __future__ import annotations

import heapq
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from slopecli.products.drawing.marks import COLOURS
from slopecli.types import FloatArray

SLOPE_RANGE_DEG = (0.0, 30.0)  # twice the usual tolerance of landers; fixed, never stretched to the data
HUES = 12  # of a map of regions
NO_REGION = COLOURS["no region"]


def slope_colours(slope_deg: ArrayLike) -> NDArray[np.uint8]:
    """Colour slopes by cividis, which reads the same with and without colour-vision deficiency.

    Source: Nunez, Anderton, Renslow, "Optimizing colormaps with consideration for color vision deficiency", 2018.

    Parameters
    ----------
    slope_deg : (n,) slopes in degrees; those outside `SLOPE_RANGE_DEG` take the colour of the nearer end.

    Returns
    -------
    (n, 3) uint8 RGB.
    """
    low, high = SLOPE_RANGE_DEG
    fraction = np.clip((np.atleast_1d(np.asarray(slope_deg, float)) - low) / (high - low), 0.0, 1.0)
    level = np.rint(255.0 * fraction).astype(np.uint8)
    return _cividis()[level]


def slope_range_colours(places: FloatArray) -> NDArray[np.uint8]:
    """Return colours (n, 3) uint8 RGB along `SLOPE_RANGE_DEG`; places (n,) run from 0 at its low end to 1."""
    low, high = SLOPE_RANGE_DEG
    return slope_colours(low + places * (high - low))


@lru_cache(maxsize=1)
def _cividis() -> NDArray[np.uint8]:
    """(256, 3) RGB of every level; OpenCV makes the map anew at every call."""
    levels = np.arange(256, dtype=np.uint8)[:, None]  # (n, 1): OpenCV 4 and 5 differ on 1-D input
    return np.ascontiguousarray(cv2.applyColorMap(levels, cv2.COLORMAP_CIVIDIS)[:, 0, ::-1])


def map_colours(labels: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Choose a colour for every region of a label map, other than those of its neighbours.

    Neighbours are regions that touch or have nothing but unlabelled ground between them. The colours depend on the
    map only.

    Parameters
    ----------
    labels : (h, w) int32, ids from 1 on, 0 for none.

    Returns
    -------
    (n + 1, 3) uint8 RGB by id; that of 0 is dark.
    """
    neighbours = _neighbours(labels)
    chosen, used = np.zeros(len(neighbours), int), [0] * HUES
    seen: set[int] = set()
    for region in _smallest_last(neighbours):
        taken = {int(chosen[other]) for other in neighbours[region] if other in seen}
        chosen[region] = min(range(HUES), key=lambda hue: (hue in taken, used[hue]))
        used[chosen[region]] += 1
        seen.add(region)
    colours = _palette()[chosen]
    colours[0] = NO_REGION
    return colours


def _palette() -> NDArray[np.uint8]:
    """(HUES, 3) RGB: steps of five twelfths round the circle, so that those used first differ most; two lightnesses."""
    index = np.arange(HUES)
    hsv = np.column_stack([index * 5 % HUES * (180 / HUES), 200 - 60 * (index % 2), 255 - 65 * (index // 2 % 2)])
    return np.asarray(cv2.cvtColor(hsv.astype(np.uint8)[None], cv2.COLOR_HSV2RGB)[0], np.uint8)


def _neighbours(labels: NDArray[np.int32]) -> list[set[int]]:
    """Ids next to each id, once every unlabelled pixel is given to the region nearest to it.

    Of a large map some rows and columns are looked at, as a picture of 512 px would show them.
    """
    found: list[set[int]] = [set() for _ in range(int(labels.max(initial=0)) + 1)]
    step = max(1, min(labels.shape) // 512)
    labels = labels[::step, ::step]
    if not labels.any():
        return found
    _, nearest = cv2.distanceTransformWithLabels(
        (labels == 0).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    owner = np.zeros(int(nearest.max()) + 1, np.int64)
    owner[nearest[labels > 0]] = labels[labels > 0]
    filled = owner[nearest]
    sides = ((filled[:, 1:], filled[:, :-1]), (filled[1:], filled[:-1]))  # side by side, one above the other
    codes = np.unique(np.concatenate([a[a != b] * len(found) + b[a != b] for a, b in sides]))
    for a, b in np.column_stack(np.divmod(codes, len(found))).tolist():
        found[a].add(b)
        found[b].add(a)
    return found


def _smallest_last(neighbours: list[set[int]]) -> list[int]:
    """Order in which each region comes after most of its neighbours: on a flat map at most five come before it.

    Source: Matula, Beck, "Smallest-last ordering and clustering and graph coloring algorithms", 1983.
    """
    degrees = [len(each) for each in neighbours]
    heap = [(degree, region) for region, degree in enumerate(degrees) if region]
    heapq.heapify(heap)
    order: list[int] = []
    done: set[int] = set()
    while heap:
        degree, region = heapq.heappop(heap)
        if region in done or degree != degrees[region]:
            continue
        done.add(region)
        order.append(region)
        for other in neighbours[region] - done:
            degrees[other] -= 1
            heapq.heappush(heap, (degrees[other], other))
    return order[::-1]
