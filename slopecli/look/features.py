"""Sparse features: where the images look alike, before anything is known about the motion."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.types import FloatArray, IntArray

Grey = NDArray[np.uint8]
Descriptors = NDArray[np.float32]

BLOCK = 1024  # descriptors compared with all others at a time


@dataclass(frozen=True)
class FeatureEffort:
    """How hard to look. Pixels beyond `max_pixels` are averaged away: SIFT's cost grows with area, its use does not."""

    max_pixels: float
    n_features: int
    contrast: float
    ratio: float  # Lowe's ratio of best to second-best descriptor distance


# What a glance takes: enough for a motion where all matches agree.
GLANCE = FeatureEffort(max_pixels=0.07e6, n_features=600, contrast=0.02, ratio=0.80)
# The first suffices for textured ground; the second is spent only where the first found little.
EFFORTS = (
    FeatureEffort(max_pixels=0.4e6, n_features=4000, contrast=0.02, ratio=0.80),
    FeatureEffort(max_pixels=1.6e6, n_features=7000, contrast=0.005, ratio=0.85),
)


def shrink(grey: Grey, max_pixels: float) -> tuple[Grey, FloatArray]:
    """Area-average an image down to at most `max_pixels`.

    Returns the image and its exact scale per axis, (2,): rounding the size makes the two differ, and assuming
    otherwise shifts matches by half a pixel at the far side.
    """
    height, width = grey.shape
    factor = np.sqrt(max_pixels / grey.size)
    if factor >= 1:
        return grey, np.ones(2)
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.uint8), np.array([size[0] / width, size[1] / height])


def to_full(uv: FloatArray, scale: FloatArray) -> FloatArray:
    """Pixels of a shrunken image as pixels of the full one; centres at integers in both."""
    return (np.asarray(uv, float) + 0.5) / scale - 0.5


def detect_sift(grey: Grey, effort: FeatureEffort) -> tuple[FloatArray, Descriptors]:
    """SIFT points (n, 2) px of the full image and RootSIFT descriptors (n, 128) (Arandjelovic and Zisserman 2012)."""
    small, scale = shrink(grey, effort.max_pixels)
    # without precise upscaling SIFT's points are biased by a twentieth of a pixel
    sift = cv2.SIFT_create(  # type: ignore[attr-defined]
        nfeatures=effort.n_features, contrastThreshold=effort.contrast, enable_precise_upscale=True
    )
    keypoints, descriptors = sift.detectAndCompute(small, None)  # type: ignore[call-overload]
    if descriptors is None or len(keypoints) == 0:
        return np.empty((0, 2)), np.empty((0, 128), np.float32)
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-9))
    return to_full(np.array([point.pt for point in keypoints]), scale), root.astype(np.float32)


def match_descriptors(first: Descriptors, second: Descriptors, ratio: float) -> tuple[IntArray, IntArray]:
    """Mutual nearest neighbours that beat the second best by `ratio`, as index pairs.

    The descriptors are unit vectors, so distances follow from matrix products, taken in blocks to bound the memory.
    """
    if len(first) < 2 or len(second) < 2:
        return np.empty(0, int), np.empty(0, int)
    column_best = np.full(len(second), -np.inf, np.float32)
    blocks = [_best_two(first[k : k + BLOCK], second, column_best) for k in range(0, len(first), BLOCK)]
    partner, best, runner_up = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    mutual = best >= column_best[partner]
    distance = np.sqrt(np.maximum(2 - 2 * best, 0))
    keep = mutual & (distance < ratio * np.sqrt(np.maximum(2 - 2 * runner_up, 1e-12)))
    return np.flatnonzero(keep), partner[keep]


def _best_two(
    first: Descriptors, second: Descriptors, column_best: NDArray[np.float32]
) -> tuple[IntArray, NDArray[np.float32], NDArray[np.float32]]:
    """Most similar partner, its similarity and the next best; raises `column_best` (len(second),) in place."""
    similarity = first @ second.T
    np.maximum(column_best, similarity.max(0), out=column_best)
    rows, partner = np.arange(len(first)), similarity.argmax(1)
    best = similarity[rows, partner]
    similarity[rows, partner] = -np.inf
    return partner, best, similarity.max(1)


class FeatureMemory:
    """SIFT features of the images seen last, for pairs that share images.

    What it gives is what `detect_sift` gives, to the last bit. It holds the features of `n_images` images, of at most
    7 MB each, and may not be shared by threads.
    """

    def __init__(self, n_images: int = 2) -> None:
        self._most = n_images * (1 + len(EFFORTS))
        self._held: dict[tuple[bytes, FeatureEffort], tuple[FloatArray, Descriptors]] = {}  # the last used at the end

    def detect(self, grey: Grey, effort: FeatureEffort) -> tuple[FloatArray, Descriptors]:
        """Points (n, 2) px and descriptors (n, 128) of an image; not to be written to."""
        key = (_digest(grey), effort)
        features = self._held.pop(key, None) or detect_sift(grey, effort)
        for array in features:
            array.flags.writeable = False
        self._held[key] = features
        while len(self._held) > self._most:
            del self._held[next(iter(self._held))]
        return features


def _digest(grey: Grey) -> bytes:
    digest = hashlib.sha256(str(grey.shape).encode())
    digest.update(np.ascontiguousarray(grey).data)
    return digest.digest()


def match_sift(
    grey1: Grey, grey2: Grey, effort: FeatureEffort, memory: FeatureMemory | None = None
) -> tuple[FloatArray, FloatArray, tuple[int, int]]:
    """Tentative matches as pixels of the full images, (n, 2) each, about a third of them wrong; features per image.

    memory : of features, where the images may have been seen before.
    """
    detect = detect_sift if memory is None else memory.detect
    uv1, descriptors1 = detect(grey1, effort)
    uv2, descriptors2 = detect(grey2, effort)
    i, j = match_descriptors(descriptors1, descriptors2, effort.ratio)
    return (*_drop_repeats(uv1[i], uv2[j]), (len(uv1), len(uv2)))


def _drop_repeats(uv1: FloatArray, uv2: FloatArray) -> tuple[FloatArray, FloatArray]:
    """SIFT gives one point several orientations; counted twice, a mismatch votes twice."""
    first: dict[tuple[float, ...], int] = {}
    for index, place in enumerate(np.round(np.hstack([uv1, uv2]), 1).tolist()):
        first.setdefault(tuple(place), index)
    chosen = list(first.values())
    return uv1[chosen], uv2[chosen]
