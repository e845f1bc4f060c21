"""Inverse depth of every pixel of one image from several others: their mean, weighted by what each knows of it.

The noise of a depth is that of its alignment, in px, over the displacement that depth makes: the image taken from
farthest away tells most. Planes are to be fitted to the fused depth; planes of single pairs have errors in common.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.statistics import CERTAIN_SIGMAS, robust_sigma
from slopecli.look.dense_depth import DenseDepth
from slopecli.look.noise import SYSTEMATIC_PX
from slopecli.look.warp import FloatImage
from slopecli.types import BoolArray


class FusionTunables(NamedTuple):
    """How depths of several pairs are compared."""

    # baseline, of the distance, at which the displacement that makes a step (`DEPTH.step_gradient`) tells steps from
    # slopes: with three times as much all ground seen at an angle would be one
    steps_at: float = 0.15
    beside_px: int = 5  # grid px to either side over which a depth to begin with is smoothed, see `start_for_farther`


FUSION = FusionTunables()


def fuse_depths(depths: Sequence[DenseDepth], baselines: Sequence[float]) -> DenseDepth:
    """The depths of one image's pixels under several others as one, in baselines of the first of them.

    depths : over the same working grid.  baselines : their lengths, in any one unit.

    Returns
    -------
    fused : as of the first pair; pixels that only others show are known, too, with `shifts`, `across_px` and `along_px`
        of the best of them, which the noise follows from.
    """
    first = depths[0]
    if len(depths) == 1:
        return first
    noise = [_noise(depth) for depth in depths]
    logarithms = [
        np.log(depth.w) + np.float32(np.log(baselines[0] / length))
        for depth, length in zip(depths, baselines, strict=True)
    ]
    information = [
        np.where(depth.known, (depth.shift_px / sigma) ** 2, 0.0).astype(np.float32)
        for depth, sigma in zip(depths, noise, strict=True)
    ]
    mean = _mean(logarithms, information)
    for _ in range(2):
        kept = [_near(value, weight, mean) for value, weight in zip(logarithms, information, strict=True)]
        mean = _mean(logarithms, kept)
    total = np.sum(kept, axis=0)
    known = total > 0.0
    sure, step = _steps(depths, kept)
    # pairs share the noise and the smoothing of image 1, so the mean is trusted like one of them: the first where it
    # is known, else the best
    trusted = np.where(kept[0] > 0.0, 0, np.argmax(kept, axis=0))[None]
    left = ("across_px", "along_px")
    return replace(
        first,
        w=np.where(known, np.exp(mean), first.w).astype(np.float32),
        known=known,
        sure=known & sure,
        step=np.where(known, step, first.step),
        shifts=np.take_along_axis(np.stack([d.shifts for d in depths]), trusted[..., None], axis=0)[0],
        **{name: np.take_along_axis(np.stack([getattr(d, name) for d in depths]), trusted, axis=0)[0] for name in left},
    )


def start_for_farther(depths: Sequence[DenseDepth], baselines: Sequence[float]) -> FloatImage:
    """(h, w) inverse depth, one over the unit of the baselines, for the alignment of an image from farther away.

    The longest baseline first. Noise would stay where that image has little texture, so it is smoothed, but not across
    steps: a bilateral filter.
    """
    fused = fuse_depths(depths, baselines)
    shift_px = float(np.median(fused.shift_px[fused.known])) if fused.known.any() else 1.0
    reach, like = FUSION.beside_px, 1.0 / max(shift_px, 1e-3)  # px of displacement
    smooth = cv2.bilateralFilter(np.log(fused.w), 2 * reach + 1, like, reach / 1.5)
    return np.asarray(np.exp(smooth) / np.float32(baselines[0]), np.float32)


def _steps(depths: Sequence[DenseDepth], weights: Sequence[FloatImage]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """(h, w) pixels that are beside no step, and those on one: as the pair of the most telling baseline has it, or
    where that does not show them, most of the others by weight."""
    away = [abs(np.log(max(_separation(depth), 1e-9) / FUSION.steps_at)) for depth in depths]
    judge = depths[int(np.argmin(away))]
    half = 0.5 * np.sum(weights, axis=0)
    found = []
    for name in ("sure", "step"):
        votes = np.sum([w * getattr(depth, name) for w, depth in zip(weights, depths, strict=True)], axis=0)
        found.append(np.where(judge.known, getattr(judge, name), votes > half))
    return found[0], found[1]


def _separation(depth: DenseDepth) -> float:
    """Displacement per change of ln w, over the focal length: the baseline across the view, over the distance."""
    return float(np.median(depth.shift_px[depth.known])) / depth.focal_px if depth.known.any() else 0.0


def _noise(depth: DenseDepth) -> float:
    """1-sigma of the alignment of a pair, grid px, from what is left across its epipolar lines."""
    across = depth.across_px[depth.known].astype(float)
    return max(robust_sigma(across), SYSTEMATIC_PX) if len(across) else 1.0


def _mean(logarithms: Sequence[FloatImage], weights: Sequence[FloatImage]) -> FloatImage:
    total = np.maximum(np.sum(weights, axis=0), 1e-12)
    return np.asarray(
        sum(value * weight for value, weight in zip(logarithms, weights, strict=True)) / total, np.float32
    )


def _near(value: FloatImage, weight: FloatImage, mean: FloatImage) -> FloatImage:
    """The weight where a value is near the mean, within its noise and a hundredth of the depth; else 0."""
    off: BoolArray = np.abs(value - mean) > CERTAIN_SIGMAS * np.sqrt(1.0 / np.maximum(weight, 1e-12) + 1e-6)
    return np.asarray(np.where(off, 0.0, weight), np.float32)
