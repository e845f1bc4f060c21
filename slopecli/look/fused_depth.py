"""Inverse depth of every pixel of one image from several others: their mean, weighted by what each knows of it.

The noise of a depth is that of its alignment, in px, over the displacement that depth makes: the image taken from
farthest away tells most. Planes are to be fitted to the fused depth; planes of single pairs have errors in common.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from slopecli.geometry.statistics import robust_sigma
from slopecli.look.dense_depth import DenseDepth
from slopecli.look.noise import SYSTEMATIC_PX
from slopecli.look.warp import FloatImage
from slopecli.types import BoolArray

FAR_OFF = 3.0  # sigmas: a depth farther from the mean than this is a mismatch, or is hidden in that image


def fuse_depths(depths: Sequence[DenseDepth], baselines: Sequence[float]) -> DenseDepth:
    """The depths of one image's pixels under several others as one, in baselines of the first of them.

    depths : over the same working grid.  baselines : their lengths, in any one unit.

    Returns
    -------
    fused : as of the first pair; pixels that only others show are known, too, with `shifts` and `across_px` of the best
        of them, which the noise follows from.
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
    sure = np.sum([weight * depth.sure for weight, depth in zip(kept, depths, strict=True)], axis=0) > 0.5 * total
    step = np.sum([weight * depth.step for weight, depth in zip(kept, depths, strict=True)], axis=0) > 0.5 * total
    known = total > 0.0
    # pairs share the noise and the smoothing of image 1, so the mean is trusted like one of them: the first where it
    # is known, else the best
    trusted = np.where(kept[0] > 0.0, 0, np.argmax(kept, axis=0))
    return replace(
        first,
        w=np.where(known, np.exp(mean), first.w).astype(np.float32),
        known=known,
        sure=known & sure,
        step=np.where(known, step, first.step),
        shifts=np.take_along_axis(np.stack([d.shifts for d in depths]), trusted[None, ..., None], axis=0)[0],
        across_px=np.take_along_axis(np.stack([d.across_px for d in depths]), trusted[None], axis=0)[0],
    )


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
    off: BoolArray = np.abs(value - mean) > FAR_OFF * np.sqrt(1.0 / np.maximum(weight, 1e-12) + 1e-6)
    return np.asarray(np.where(off, 0.0, weight), np.float32)
