"""What the checks look at: of a pair before its planes are found, and of the finished planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from slopecli.findings.separation import Separation
from slopecli.geometry.epipolar import homogeneous
from slopecli.geometry.statistics import median
from slopecli.look.changes import Change
from slopecli.look.scene import Scene
from slopecli.options import Options
from slopecli.patches.given.rows import RAYS
from slopecli.patches.join import Joined
from slopecli.patches.patch import Patch
from slopecli.types import BoolArray, Camera, FloatArray, Image, Plane, Solution


@dataclass(frozen=True, eq=False)
class PairFacts:
    """A pair of images with its scene.  noise_px : 1-sigma of a match across its epipolar line."""

    images: tuple[Image, Image]
    scene: Scene
    noise_px: float
    options: Options


@dataclass(frozen=True, eq=False)
class AnswerFacts:
    """The planes of an answer, and what they were computed from.

    noise : 1-sigma of a match of weight one by its residuals, normalised coordinates.
    labels : (h, w) plane id per pixel of image 1, 0 for none.
    length_m : between the cameras, None where it is not known.
    epipole1_px : in image 1, None where it lies outside.
    changes : areas of image 1 that changed between the images.
    """

    planes: tuple[Plane, ...]
    solution: Solution
    joined: Joined
    camera2: Camera
    options: Options
    noise: float
    labels: NDArray[np.uint16]
    length_m: float | None = None
    epipole1_px: tuple[float, float] | None = None
    changes: Sequence[Change] = field(default_factory=tuple)

    @property
    def focal_px(self) -> float | None:
        """Focal length of camera 2, None for rays without a camera."""
        return None if self.camera2 is RAYS else self.camera2.focal_px

    @property
    def noise_px(self) -> float:
        """1-sigma of the median match, px; NaN without a camera."""
        return float("nan") if self.focal_px is None else self.noise_of_median * self.focal_px

    @property
    def noise_of_median(self) -> float:
        """1-sigma of the median match, normalised coordinates."""
        return self.noise / float(np.sqrt(median(self.joined.weight)))

    @cached_property
    def separation(self) -> Separation:
        """How far apart the images were taken, by the distances of what lies on planes."""
        joined, normals = self.joined, self.solution.scaled_normals
        on = joined.plane >= 0
        inverse_depth = (homogeneous(joined.matches.x1[on]) * normals[joined.plane[on]]).sum(1)
        return Separation(abs(median(inverse_depth)), self.length_m)

    @cached_property
    def patch_of(self) -> dict[int, Patch]:
        """The patch of every plane, by its id."""
        return {patch.id: patch for patch in self.joined.patches}

    @cached_property
    def relief(self) -> dict[int, float]:
        """RMS height off the plane over its distance, by the id of the patch."""
        return {patch.id: float(r) for patch, r in zip(self.joined.patches, self.solution.relief, strict=True)}

    def holds(self, plane: Plane, points: FloatArray) -> BoolArray:
        """(n,) whether points (n, 2) of image 1 lie in a window, or on a pixel of a plane of any shape."""
        if plane.found:
            columns, rows = np.floor(points + 0.5).astype(int).T
            return np.asarray(self.labels[rows, columns] == plane.id)
        low, high = plane.polygon_px.min(0), plane.polygon_px.max(0)
        return np.asarray(((low < points) & (points < high)).all(1))
