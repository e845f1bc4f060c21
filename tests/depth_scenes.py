"""Rendered pairs as scenes under their true motion, and what the dense depth says of them, for tests of maps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scenery import Pair, pixel_grid

from slopecli.geometry import homogeneous, rays_from_pixels
from slopecli.look import DenseDepth, Evidence, Pyramid, Scene
from slopecli.types import FloatArray

SPACING_PX = 8  # between matches of the overview
ERROR = 0.02  # 1-sigma of the logarithm of their inverse depth
NO_CELLS = None  # a map does not look at them


def scene_of(pair: Pair, seed: int = 0) -> Scene:
    """The scene of a pair with its true motion, and matches of the overview that err in depth."""
    first, second = pair.camera1, pair.camera2
    uv1 = pixel_grid(first.width, first.height)[SPACING_PX // 2 :: SPACING_PX, SPACING_PX // 2 :: SPACING_PX]
    uv1 = uv1.reshape(-1, 2)
    uv2 = pair.transfer(uv1)
    inside = ((uv2 > 1) & (uv2 < np.array([second.width, second.height]) - 2)).all(1)
    uv1, uv2 = (uv[inside & ~pair.hidden(uv1)] for uv in (uv1, uv2))
    x1, x2 = rays_from_pixels(first, uv1), rays_from_pixels(second, uv2)
    w = pair.inverse_depth(uv1) * np.exp(ERROR * np.random.default_rng(seed).standard_normal(len(uv1)))
    step = 1e-5
    leverage = np.linalg.norm(_seen(pair, x1, w + step) - _seen(pair, x1, w), axis=1) / step
    evidence = Evidence(uv1, uv2, x1, x2, w, leverage, np.ones(len(uv1)), second.focal_px, len(uv1))
    pyramids = Pyramid(pair.grey1), Pyramid(pair.grey2)
    return Scene(first, second, *pyramids, pair.R, pair.T, evidence, lambda: [], NO_CELLS)  # type: ignore[arg-type]


def _seen(pair: Pair, x1: FloatArray, w: FloatArray) -> FloatArray:
    moved = (homogeneous(x1) - w[:, None] * pair.T) @ pair.R.T
    return np.asarray(moved[:, :2] / moved[:, 2:])


def pixels1(depth: DenseDepth) -> FloatArray:
    """(h, w, 2) px of image 1 of the pixels of a working grid."""
    height, width = depth.grid.shape
    return depth.grid.full(pixel_grid(width, height))


def error_px(depth: DenseDepth, pair: Pair) -> FloatArray:
    """(h, w) error of the inverse depth as a displacement on the working grid, px."""
    true = pair.inverse_depth(pixels1(depth).reshape(-1, 2)).reshape(depth.w.shape)
    return np.asarray(np.log(depth.w / true) * depth.shift_px)


def true_depth(depth: DenseDepth, pair: Pair) -> DenseDepth:
    """The same pixels with their true inverse depth, all of them known."""
    true = pair.inverse_depth(pixels1(depth).reshape(-1, 2)).reshape(depth.w.shape).astype(np.float32)
    every = np.ones_like(depth.known)
    nothing = np.zeros_like(depth.w)
    return replace(depth, w=true, known=every, sure=every, step=~every, across_px=nothing, along_px=nothing)
