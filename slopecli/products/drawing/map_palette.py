"""Colours for a map of regions: few and distinct, never the same for two neighbours (graph colouring)."""

from __future__ import annotations

import heapq

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.types import IntArray

HUES = 12
NO_REGION = (30, 30, 34)


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
    """Ids next to each id, once every unlabelled pixel is given to the region nearest to it."""
    found: list[set[int]] = [set() for _ in range(int(labels.max(initial=0)) + 1)]
    if not labels.any():
        return found
    _, nearest = cv2.distanceTransformWithLabels(
        (labels == 0).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    owner = np.zeros(int(nearest.max()) + 1, np.int64)
    owner[nearest[labels > 0]] = labels[labels > 0]
    filled = owner[nearest]
    for a, b in _unlike_pairs(filled, len(found)):
        found[a].add(b)
        found[b].add(a)
    return found


def _unlike_pairs(labels: IntArray, count: int) -> list[list[int]]:
    """Pairs of different ids side by side or one above the other."""
    sides = ((labels[:, 1:], labels[:, :-1]), (labels[1:], labels[:-1]))
    codes = np.unique(np.concatenate([a[a != b] * count + b[a != b] for a, b in sides]))
    pairs: list[list[int]] = np.column_stack(np.divmod(codes, count)).tolist()
    return pairs


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
