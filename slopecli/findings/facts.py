"""What the checks look at: of a pair before its planes are found, and of the planes of its report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from slopecli.findings.level_evidence import LevelOdds
from slopecli.findings.wording import Separation
from slopecli.geometry.camera import pixels_from_rays
from slopecli.geometry.epipolar import focus_of_expansion, homogeneous
from slopecli.geometry.statistics import median
from slopecli.look.changes import Change
from slopecli.look.scene import Scene
from slopecli.options import Options
from slopecli.patches.given import RAYS
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
    """The planes of a report, and what they were computed from.

    labels : (h, w) plane id per pixel of image 1, 0 for none.
    length_m : between the cameras, None where it is not known.
    changes : areas of image 1 that changed between the images.
    level : how probable it is that up is up, None where it was given or nothing tells.
    """

    planes: tuple[Plane, ...]
    solution: Solution
    joined: Joined
    cameras: tuple[Camera, Camera]
    options: Options
    labels: NDArray[np.uint16]
    length_m: float | None = None
    changes: Sequence[Change] = field(default_factory=tuple)
    level: LevelOdds | None = None

    @property
    def focal_px(self) -> float | None:
        """Focal length of camera 2, None for rays without a camera."""
        return None if self.cameras[1] is RAYS else self.cameras[1].focal_px

    @cached_property
    def epipole1_px(self) -> tuple[float, float] | None:
        """Pixel of image 1 the camera moves towards or away from, None when it is not inside the image."""
        return epipole1_px(self.solution, self.cameras[0])

    @cached_property
    def noise(self) -> float:
        """1-sigma of a match of weight one, normalised; of given correspondences by residuals, at most as given."""
        solution, joined = self.solution, self.joined
        if joined.patches[0].source != "given":
            return solution.noise
        residuals = 2 * int(solution.inlier.sum()) - int((joined.plane[solution.inlier] < 0).sum())
        freedom = residuals - 5 - 3 * len(solution.scaled_normals)
        return float(solution.noise * min(np.sqrt(solution.chi2 / max(freedom, 1)), 1.0))

    @property
    def noise_px(self) -> float:
        """1-sigma of the median match, px; NaN without a camera."""
        if self.focal_px is None:
            return float("nan")
        return self.noise / float(np.sqrt(median(self.joined.weight))) * self.focal_px

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


def epipole1_px(solution: Solution, camera1: Camera) -> tuple[float, float] | None:
    """Pixel of image 1 the camera moves towards or away from, None when it is not inside the image."""
    focus = focus_of_expansion(solution.T)
    if focus is None:
        return None
    u, v = pixels_from_rays(camera1, focus[None])[0]
    inside = -0.5 <= u < camera1.width - 0.5 and -0.5 <= v < camera1.height - 0.5  # False for NaN, too
    return (float(u), float(v)) if inside else None
