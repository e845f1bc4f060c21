"""Regions held against their own matches: several planes under one label are parted, and what no match bears out goes.

A label says that a plane sends a pixel where image 2 looks alike. A bare surface looks alike wherever it is sent, and
a plane that cuts through houses at one height finds something alike in each of them; matches tell.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.metrics import normal_angle
from slopecli.look.gradient_components import Labels, grown
from slopecli.patches.regions.cell_planes import RegionCells, nearest, robust_planes
from slopecli.types import BoolArray, FloatArray, IntArray

FEWEST_CELLS = 14  # that speak for a plane of their own
LEAST_GAIN = 60.0  # squared sigmas two planes must save over one: neighbouring cells share their errors
PIECE_GAIN = 40.0  # the same of a piece apart from the rest, whose border is known
LEAST_ANGLE = np.radians(6.0)  # between planes worth parting: steps in a facade face one way
LEAST_RATIO = 1.3  # by which the misfit of a cell must fall, too: relief is no hinge
TRUNCATED = 25.0  # squared sigmas: a cell on another plane costs no more
SAMPLE = 400  # cells of a region that decide whether it is two planes
SEEDS, NEIGHBOURS = 60, (8, 16)  # neighbourhoods that propose planes, and the cells in them
FIRSTS = 12  # best single planes that are tried as one of two
AROUND = 9  # cells that vote on which of two planes one of them lies on
ROUNDS = 4  # of voting and fitting: parts no longer change then
GAP = 0.08  # of the image's longer side: wider gaps between a region's matches are not its own
REMOTE = 3.0  # widths of the larger of two pieces, beyond which they are apart
RIM = 4  # cells around its matches that a region keeps: flow is not measured up to its border


def reviewed(
    labels: Labels, cells: RegionCells, at: IntArray, cell: int, least_px: float, rng: np.random.Generator
) -> Labels:
    """Label map (h, w), numbered anew by size, of what the cells bear out.

    Parameters
    ----------
    labels : (h, w) 1..k, 0 for none.
    cells : dense matches, `at` (n, 2): the row and column of the pixel amid each, `cell`: px a side of one.
    least_px : smaller regions go.
    """
    kept = np.zeros_like(labels)
    parted = _parted(labels, cells, at, rng)
    for number in range(1, int(parted.max()) + 1):
        region = parted == number
        kept[region & _borne_out(at[region[tuple(at.T)]] // cell, cell, labels.shape)] = number
    return _by_size(kept, least_px)


def _by_size(labels: Labels, least_px: float) -> Labels:
    size = np.bincount(labels.ravel())
    size[0] = 0
    order = [k for k in np.argsort(-size, kind="stable") if size[k] >= max(least_px, 1)]
    number = np.zeros(len(size), np.int32)
    number[order] = np.arange(1, len(order) + 1)
    return number[labels]


def _borne_out(matched: IntArray, cell: int, shape: tuple[int, int]) -> BoolArray:
    """(h, w) pixels among matched cells (n, 2) rows and columns of cells, or near one."""
    reach = int(GAP * max(shape) / cell)
    around = 2 * reach + RIM  # so that closing does not see the border
    rows, columns = -(-shape[0] // cell), -(-shape[1] // cell)
    mask = np.zeros((rows + 2 * around, columns + 2 * around), np.uint8)
    mask[matched[:, 0] + around, matched[:, 1] + around] = 1
    near = cv2.dilate(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, _disk(reach)), _disk(RIM)) > 0
    near = near[around : around + rows, around : around + columns]
    return near.repeat(cell, 0).repeat(cell, 1)[: shape[0], : shape[1]]


def _disk(radius: int) -> NDArray[np.uint8]:
    side = 2 * radius + 1
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side)), np.uint8)


def _parted(labels: Labels, cells: RegionCells, at: IntArray, rng: np.random.Generator) -> Labels:
    """Labels with a number of its own for every plane that was found under the label of another."""
    result, waiting = labels.copy(), list(range(1, int(labels.max()) + 1))
    count, most = len(waiting), 3 * len(waiting)
    while waiting and count < most:
        number = waiting.pop()
        for part in _other_planes(result == number, cells, at, rng):
            count += 1
            result[part] = count
            waiting += [number, count]
    return result


def _other_planes(region: BoolArray, cells: RegionCells, at: IntArray, rng: np.random.Generator) -> list[BoolArray]:
    """Masks (h, w) of the parts of a region that lie on planes of their own; none where it is one plane."""
    own = np.flatnonzero(region[tuple(at.T)])
    if len(own) < 2 * FEWEST_CELLS:
        return []
    cells, at = cells.take(own), at[own]
    count, numbered, statistics, _ = cv2.connectedComponentsWithStats(region.astype(np.uint8), connectivity=4)
    pieces, boxes = numbered.astype(np.int32), statistics.astype(np.int64)
    piece = pieces[tuple(at.T)]
    asked = [k for k in range(1, count) if np.count_nonzero(piece == k) >= FEWEST_CELLS]
    return (
        _remote_pieces(pieces, boxes, asked)
        or _pieces_apart(region, pieces, asked, cells, piece)
        or _across_hinge(region, cells, at, rng)
    )


def _remote_pieces(pieces: Labels, boxes: IntArray, asked: list[int]) -> list[BoolArray]:
    """All groups of pieces but the largest, where groups lie farther from one another than their pieces are wide.

    That a plane passes through two small things at opposite ends of the image says nothing of either of them.

    boxes : (p, 5) left, top, width, height and area of the pieces; asked : those with matches enough to be judged by.
    """
    if len(asked) < 2:
        return []
    low, side = boxes[:, :2], np.sqrt(boxes[:, 4])
    high = low + boxes[:, 2:4]
    between = np.maximum(low[:, None] - high[None, asked], low[None, asked] - high[:, None])
    gap = np.hypot(*np.maximum(between, 0).transpose(2, 0, 1))
    reach = np.maximum(REMOTE * np.maximum(side[asked, None], side[None, asked]), GAP * max(pieces.shape))
    group = _connected(gap[asked] <= reach)
    of_piece = group[gap.argmin(1)]  # small pieces go with the nearest
    of_piece[0] = -1
    area = np.bincount(group, boxes[asked, 4])
    return [np.isin(pieces, np.flatnonzero(of_piece == k)) for k in np.unique(group) if k != area.argmax()]


def _connected(neighbours: BoolArray) -> IntArray:
    """(n,) the first node of the component of every node, from who is whose neighbour (n, n)."""
    first = np.arange(len(neighbours))
    for _ in first:
        first = np.where(neighbours, first, len(first)).min(1)
    return first


def _pieces_apart(
    region: BoolArray, pieces: Labels, asked: list[int], cells: RegionCells, piece: IntArray
) -> list[BoolArray]:
    """Connected pieces whose matches contradict the plane of all.

    piece : (n,) of every cell.
    """
    if len(asked) < 2:
        return []
    plane = _plane(cells)
    apart = [k for k in asked if _contradicts(cells.take(np.flatnonzero(piece == k)), plane)]
    masks = [pieces == k for k in apart]
    if apart and len(apart) == len(asked):
        # the plane of all has no piece that bears it out: the rest goes with it
        masks[-1] |= region & ~np.isin(pieces, asked)
    return masks


def _contradicts(cells: RegionCells, plane: FloatArray) -> bool:
    own = _plane(cells)
    gain = _misfit(cells, plane) - _misfit(cells, own)
    return gain > PIECE_GAIN and float(normal_angle(plane, own)) > LEAST_ANGLE


def _across_hinge(region: BoolArray, cells: RegionCells, at: IntArray, rng: np.random.Generator) -> list[BoolArray]:
    """The smaller of two parts of a region that lie on two planes, where two explain its matches far better."""
    sample = rng.permutation(len(cells))[:SAMPLE]
    cells, at = cells.take(sample), at[sample]
    second = _second_plane(cells, rng)
    if second is None:
        return []
    seeds = np.zeros(region.shape, np.int32)
    seeds[tuple(at.T)] = 1 + second
    part = region & (grown(seeds, float(sum(region.shape))) == 2)
    return [part] if part.any() and (region & ~part).any() else []


def _second_plane(cells: RegionCells, rng: np.random.Generator) -> BoolArray | None:
    """(n,) cells on the second of two planes, None where one plane does hardly worse."""
    planes = _two_planes(cells, rng)
    around = nearest(cells.uv1, np.arange(len(cells)), min(AROUND, len(cells)))
    for _ in range(ROUNDS):
        second = np.asarray(_costs(cells, planes)[around].sum(1).argmin(1) == 1)
        if not FEWEST_CELLS <= np.count_nonzero(second) <= len(cells) - FEWEST_CELLS:
            return None
        parts = cells.take(np.flatnonzero(~second)), cells.take(np.flatnonzero(second))
        planes = np.array([_plane(part) for part in parts])
    one, two = _misfit(cells, _plane(cells)), sum(_misfit(*pair) for pair in zip(parts, planes, strict=True))
    if one - two < LEAST_GAIN or one < LEAST_RATIO * two or normal_angle(*planes) < LEAST_ANGLE:
        return None
    return second if second.mean() <= 0.5 else ~second


def _two_planes(cells: RegionCells, rng: np.random.Generator) -> FloatArray:
    """(2, 3) planes of neighbourhoods that together explain the cells best."""
    seeds = rng.permutation(len(cells))[:SEEDS]
    groups = [nearest(cells.uv1, seeds, size) for size in NEIGHBOURS]
    of_groups = [robust_planes(cells.rows[near], cells.target[near]) for near in groups]
    proposed = np.vstack([_plane(cells), *of_groups])
    cost = _costs(cells, proposed)
    firsts = cost.sum(0).argsort()[:FIRSTS]
    together = np.array([np.minimum(cost[:, [first]], cost).sum(0) for first in firsts])
    first, second = np.unravel_index(together.argmin(), together.shape)
    return np.asarray(proposed[[firsts[first], second]])


def _plane(cells: RegionCells) -> FloatArray:
    return np.asarray(robust_planes(cells.rows[None], cells.target[None])[0])


def _costs(cells: RegionCells, planes: FloatArray) -> FloatArray:
    """(n, k) squared distance of cells from planes (k, 3), in sigmas, truncated."""
    return np.minimum((cells.target[:, None] - cells.rows @ planes.T) ** 2, TRUNCATED)


def _misfit(cells: RegionCells, plane: FloatArray) -> float:
    return float(_costs(cells, plane[None]).sum())
