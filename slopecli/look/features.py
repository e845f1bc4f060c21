"""Sparse features: SIFT keypoints of two images, matched by descriptor."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.types import Camera, FloatArray, IntArray

Grey = NDArray[np.uint8]
Descriptors = NDArray[np.float32]


class Images(NamedTuple):
    """Grey values and cameras of a pair."""

    grey1: Grey
    grey2: Grey
    camera1: Camera
    camera2: Camera


@dataclass(frozen=True)
class FeatureEffort:
    """Settings of SIFT. Images are shrunk to `max_pixels`: the cost grows with the area, the matches do not improve."""

    max_pixels: float
    n_features: int
    contrast: float  # threshold of SIFT
    ratio: float  # Lowe's: largest ratio of the distances to the best and to the second-best descriptor


# Of the quick pass: enough for a motion where all matches agree.
QUICK = FeatureEffort(max_pixels=0.07e6, n_features=600, contrast=0.02, ratio=0.80)
# Tried in turn: the first suffices for textured ground, the second follows where too few matches agree.
EFFORTS = (
    FeatureEffort(max_pixels=0.4e6, n_features=4000, contrast=0.02, ratio=0.80),
    FeatureEffort(max_pixels=1.6e6, n_features=7000, contrast=0.005, ratio=0.85),
)


def shrink(grey: Grey, max_pixels: float) -> tuple[Grey, FloatArray]:
    """Area-average an image down to at most `max_pixels`.

    Returns the image and its exact scale (2,) along x and y, which differ because the size is rounded.
    """
    height, width = grey.shape
    factor = np.sqrt(max_pixels / grey.size)
    if factor >= 1:
        return grey, np.ones(2)
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8), np.array([size[0] / width, size[1] / height])


def to_full(uv: FloatArray, scale: FloatArray) -> FloatArray:
    """Pixels (..., 2) of a shrunken image as pixels of the full image; pixel centres at integers in both."""
    return (np.asarray(uv, float) + 0.5) / scale - 0.5


def detect_sift(grey: Grey, effort: FeatureEffort) -> tuple[FloatArray, Descriptors]:
    """SIFT points (n, 2) px of the full image and RootSIFT descriptors (n, 128) (Arandjelovic and Zisserman 2012)."""
    small, scale = shrink(grey, effort.max_pixels)
    # without precise upscaling the keypoints are biased by 0.05 px
    sift = cv2.SIFT_create(  # type: ignore[attr-defined]
        nfeatures=effort.n_features, contrastThreshold=effort.contrast, enable_precise_upscale=True
    )
    keypoints, descriptors = sift.detectAndCompute(small, None)  # type: ignore[call-overload]
    if descriptors is None or len(keypoints) == 0:
        return np.empty((0, 2)), np.empty((0, 128), np.float32)
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-9))
    return to_full(np.array([point.pt for point in keypoints]), scale), root.astype(np.float32)


def match_descriptors(first: Descriptors, second: Descriptors, ratio: float) -> tuple[IntArray, IntArray]:
    """Index pairs of mutual nearest neighbours that pass the ratio test.

    Descriptors are unit vectors, so distances follow from matrix products; blocks of rows bound the memory.
    """
    if len(first) < 2 or len(second) < 2:
        return np.empty(0, int), np.empty(0, int)
    column_best = np.full(len(second), -np.inf, np.float32)
    rows = 1024
    blocks = [_best_two(first[k : k + rows], second, column_best) for k in range(0, len(first), rows)]
    partner, best, runner_up = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    mutual = best >= column_best[partner]
    distance = np.sqrt(np.maximum(2 - 2 * best, 0))
    keep = mutual & (distance < ratio * np.sqrt(np.maximum(2 - 2 * runner_up, 1e-12)))
    return np.flatnonzero(keep), partner[keep]


def _best_two(
    first: Descriptors, second: Descriptors, column_best: NDArray[np.float32]
) -> tuple[IntArray, NDArray[np.float32], NDArray[np.float32]]:
    """For each descriptor of `first`: index and similarity of the best of `second`, and similarity of the next best.

    Updates `column_best`, the largest similarity of every descriptor of `second`, in place.
    """
    similarity = first @ second.T
    np.maximum(column_best, similarity.max(0), out=column_best)
    rows, partner = np.arange(len(first)), similarity.argmax(1)
    best = similarity[rows, partner]
    similarity[rows, partner] = -np.inf
    return partner, best, similarity.max(1)


class FeatureMemory:
    """Cache of the SIFT features of the last `n_images` images, for pairs that share images.

    Features take up to 7 MB per image. Not safe to share between threads.
    """

    def __init__(self, n_images: int = 2) -> None:
        self._most = n_images * (1 + len(EFFORTS))
        self._held: dict[tuple[bytes, FeatureEffort], tuple[FloatArray, Descriptors]] = {}  # least recently used first

    def detect(self, grey: Grey, effort: FeatureEffort) -> tuple[FloatArray, Descriptors]:
        """The result of `detect_sift`, as read-only arrays."""
        key = (hashlib.sha256(str(grey.shape).encode() + grey.tobytes()).digest(), effort)
        features = self._held.pop(key, None) or detect_sift(grey, effort)
        for array in features:
            array.flags.writeable = False
        self._held[key] = features
        while len(self._held) > self._most:
            del self._held[next(iter(self._held))]
        return features


def match_sift(
    grey1: Grey, grey2: Grey, effort: FeatureEffort, memory: FeatureMemory | None = None
) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
    """Tentative matches, (n, 2) px of the full images each, about a third of them mismatches; features per image."""
    detect = detect_sift if memory is None else memory.detect
    uv1, descriptors1 = detect(grey1, effort)
    uv2, descriptors2 = detect(grey2, effort)
    i, j = match_descriptors(descriptors1, descriptors2, effort.ratio)
    # SIFT may give one point several orientations, and so one match several times
    _, first = np.unique(np.round(np.hstack([uv1[i], uv2[j]]), 1), axis=0, return_index=True)
    first = np.sort(first)
    return uv1[i[first]], uv2[j[first]], (len(uv1), len(uv2))
