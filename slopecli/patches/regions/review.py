"""Regions checked against their matches: those on several planes are split, parts without matches are dropped.

A label says that a plane sends a pixel where image 2 looks alike. A surface without texture looks alike wherever it is
sent, and a plane that cuts through several houses finds something alike in each of them; matches show both.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.epipolar import normal_angle
from slopecli.look.gradient_components import Labels, grown, renumbered_by_size
from slopecli.patches.labelling.depth_planes import robust_planes
from slopecli.patches.neighbours import nearest
from slopecli.patches.regions.cell_planes import RegionCells
from slopecli.patches.regions.region_tunables import REGION
from slopecli.types import BoolArray, FloatArray, IntArray


def reviewed(labels: Labels, cells: RegionCells, middle: IntArray, least_px: float, rng: np.random.Generator) -> Labels:
    """Return the label map (h, w) after splitting regions and dropping parts without matches, numbered by size.

    Parameters
    ----------
    labels : (h, w) 1..k, 0 for none.
    cells : dense matches.  middle : (n, 2) row and column of the pixel in the middle of each.
    least_px : smaller regions are dropped.
    """
    kept = np.zeros_like(labels)
    split = _split(labels, cells, middle, rng)
    for number in range(1, int(split.max()) + 1):
        region = split == number
        kept[region & _near_matches(middle[region[tuple(middle.T)]], labels.shape)] = number
    return renumbered_by_size(kept, least_px)[0]


def _near_matches(middle: IntArray, shape: tuple[int, int]) -> BoolArray:
    """Return (h, w) pixels between matched cells or near one, gaps between them closed up to `gap`."""
    cell = REGION.cell_px
    matched = middle // cell
    reach = int(REGION.gap * max(shape) / cell)
    around = 2 * reach + REGION.rim_cells  # so that closing does not see the border
    rows, columns = -(-shape[0] // cell), -(-shape[1] // cell)
    mask = np.zeros((rows + 2 * around, columns + 2 * around), np.uint8)
    mask[matched[:, 0] + around, matched[:, 1] + around] = 1
    near = cv2.dilate(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, _disk(reach)), _disk(REGION.rim_cells)) > 0
    near = near[around : around + rows, around : around + columns]
    return near.repeat(cell, 0).repeat(cell, 1)[: shape[0], : shape[1]]


def _disk(radius: int) -> NDArray[np.uint8]:
    side = 2 * radius + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)


def _split(labels: Labels, cells: RegionCells, middle: IntArray, rng: np.random.Generator) -> Labels:
    """Return labels with a new number for every further plane found under one label."""
    result, waiting = labels.copy(), list(range(1, int(labels.max()) + 1))
    count, most = len(waiting), 3 * len(waiting)
    while waiting and count < most:
        number = waiting.pop()
        for part in _further_planes(result == number, cells, middle, rng):
            count += 1
            result[part] = count
            waiting += [number, count]
    return result


def _further_planes(
    region: BoolArray, cells: RegionCells, middle: IntArray, rng: np.random.Generator
) -> list[BoolArray]:
    """Return masks (h, w) of the parts of a region that lie on planes of their own; none where it is one plane."""
    own = np.flatnonzero(region[tuple(middle.T)])
    if len(own) < 2 * REGION.fewest_cells:
        return []
    cells, middle = cells.take(own), middle[own]
    count, numbered, statistics, _ = cv2.connectedComponentsWithStats(region.astype(np.uint8), connectivity=4)
    pieces, boxes = numbered.astype(np.int32), statistics.astype(np.int64)
    piece = pieces[tuple(middle.T)]
    matched = [k for k in range(1, count) if np.count_nonzero(piece == k) >= REGION.fewest_cells]
    return (
        _remote_pieces(pieces, boxes, matched)
        or _contradicting_pieces(region, pieces, matched, cells, piece)
        or _smaller_side(region, cells, middle, rng)
    )


def _remote_pieces(pieces: Labels, boxes: IntArray, matched: list[int]) -> list[BoolArray]:
    """Return all groups of pieces but the largest, where groups are farther apart than their pieces are wide.

    A plane that passes through two small things at opposite ends of the image is the plane of neither.

    boxes : (p, 5) left, top, width, height and area of the pieces.  matched : pieces with enough matches.
    """
    from scipy.sparse.csgraph import connected_components

    if len(matched) < 2:
        return []
    low, side = boxes[:, :2], np.sqrt(boxes[:, 4])
    high = low + boxes[:, 2:4]
    between = np.maximum(low[:, None] - high[None, matched], low[None, matched] - high[:, None])
    gap = np.hypot(*np.maximum(between, 0).transpose(2, 0, 1))
    width = np.maximum(side[matched, None], side[None, matched])
    reach = np.maximum(REGION.remote * width, REGION.gap * max(pieces.shape))
    count, group = connected_components(gap[matched] <= reach)
    of_piece = group[gap.argmin(1)]  # small pieces go with the nearest
    of_piece[0] = -1
    largest = np.bincount(group, boxes[matched, 4]).argmax()
    return [np.isin(pieces, np.flatnonzero(of_piece == k)) for k in range(count) if k != largest]


def _contradicting_pieces(
    region: BoolArray, pieces: Labels, matched: list[int], cells: RegionCells, piece: IntArray
) -> list[BoolArray]:
    """Return connected pieces whose matches contradict the plane of all.

    piece : (n,) of every cell.  matched : pieces with enough matches.
    """
    if len(matched) < 2:
        return []
    plane = _plane(cells)
    apart = [k for k in matched if _contradicts(cells.take(np.flatnonzero(piece == k)), plane)]
    masks = [pieces == k for k in apart]
    if apart and len(apart) == len(matched):
        # no piece agrees with the plane of all: those with few matches go with the last
        masks[-1] |= region & ~np.isin(pieces, matched)
    return masks


def _contradicts(cells: RegionCells, plane: FloatArray) -> bool:
    own = _plane(cells)
    gain = _misfit(cells, plane) - _misfit(cells, own)
    return gain > REGION.piece_gain and _angle_deg(plane, own) > REGION.split_deg


def _smaller_side(region: BoolArray, cells: RegionCells, middle: IntArray, rng: np.random.Generator) -> list[BoolArray]:
    """Return the smaller of two parts of a region, where two planes explain its matches far better than one."""
    sample = rng.permutation(len(cells))[: REGION.split_cells]
    cells, middle = cells.take(sample), middle[sample]
    second = _second_plane(cells, rng)
    if second is None:
        return []
    seeds = np.zeros(region.shape, np.int32)
    seeds[tuple(middle.T)] = 1 + second
    part = region & (grown(seeds, float(sum(region.shape))) == 2)
    return [part] if part.any() and (region & ~part).any() else []


def _second_plane(cells: RegionCells, rng: np.random.Generator) -> BoolArray | None:
    """Return which cells (n,) lie on the smaller of two planes; None where one plane is hardly worse."""
    planes = _two_planes(cells, rng)
    around = nearest(cells.uv1, 9)
    for _ in range(4):  # the parts no longer change then
        second = np.asarray(_costs(cells, planes)[around].sum(1).argmin(1) == 1)  # a vote among neighbours
        if not REGION.fewest_cells <= np.count_nonzero(second) <= len(cells) - REGION.fewest_cells:
            return None
        parts = cells.take(np.flatnonzero(~second)), cells.take(np.flatnonzero(second))
        planes = np.array([_plane(part) for part in parts])
    one, two = _misfit(cells, _plane(cells)), sum(_misfit(*pair) for pair in zip(parts, planes, strict=True))
    if one - two < REGION.split_gain or one < REGION.split_ratio * two or _angle_deg(*planes) < REGION.split_deg:
        return None
    return second if second.mean() <= 0.5 else ~second


def _two_planes(cells: RegionCells, rng: np.random.Generator) -> FloatArray:
    """Return (2, 3) planes, of all cells or of neighbourhoods, that together explain the cells best."""
    seeds = rng.permutation(len(cells))[: REGION.split_proposals]
    groups = [nearest(cells.uv1, size, seeds) for size in REGION.split_neighbourhoods]
    proposed = np.vstack([_plane(cells), *(robust_planes(cells.rows[near], cells.target[near]) for near in groups)])
    cost = _costs(cells, proposed)
    firsts = cost.sum(0).argsort(kind="stable")[:12]  # the best single planes, each tried with every other
    together = np.array([np.minimum(cost[:, [first]], cost).sum(0) for first in firsts])
    first, second = np.unravel_index(together.argmin(), together.shape)
    return np.asarray(proposed[[firsts[first], second]])


def _plane(cells: RegionCells) -> FloatArray:
    return np.asarray(robust_planes(cells.rows, cells.target))


def _angle_deg(plane: FloatArray, other: FloatArray) -> float:
    return float(np.degrees(normal_angle(plane, other)))


def _costs(cells: RegionCells, planes: FloatArray) -> FloatArray:
    """Return (n, k) truncated squared residuals of cells for planes (k, 3), in sigmas."""
    return np.minimum((cells.target[:, None] - cells.rows @ planes.T) ** 2, REGION.split_truncated)


def _misfit(cells: RegionCells, plane: FloatArray) -> float:
    return float(_costs(cells, plane[None]).sum())
