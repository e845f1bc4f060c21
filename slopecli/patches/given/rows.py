"""Correspondences given by the user, as patches with their matches."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.camera import rays_from_pixels
from slopecli.geometry.statistics import median
from slopecli.look.matches import Matches
from slopecli.patches.footprint import Footprint
from slopecli.patches.join import Joined
from slopecli.patches.patch import Patch
from slopecli.types import BoolArray, Camera, FloatArray, IntArray

WIDEST_RAY = 5.0  # tangent of the angle to the axis
RAYS = Camera(0, 0, 1.0, 1.0, 0.0, 0.0, source="rays")  # stands for no camera: its pixels are rays
FEWEST = 3  # points that make a plane


@dataclass(frozen=True, eq=False)
class Given:
    """Correspondences as read: xy1, xy2 (n, 2) px, or rays (normalised coordinates) where there is no camera.

    patch (n,) says which plane a row lies on, -1 for none.  sigma (n,): its 1-sigma in image 2, px or mrad, or None.
    """

    xy1: FloatArray
    xy2: FloatArray
    patch: IntArray
    sigma: FloatArray | None = None
    path: str = ""
    sha256: str = ""


class Hull(Footprint):
    """Footprint of given points: their convex outline, without pixels."""

    @property
    def area_px(self) -> int:
        """Area of the outline in thousandths, as rays have areas far below 1."""
        return round(1e3 * cv2.contourArea(self.polygon_px.astype(np.float32)))

    @property
    def largest_share(self) -> float:
        """It is in one piece."""
        return 1.0


def _refuse_pixels(given: Given, cameras: tuple[Camera, Camera]) -> None:
    """Raise InputError if values without a camera cannot be rays: half of them beyond 79 degrees off the axis."""
    typical = min(float(median(np.abs(xy).max(axis=1))) for xy in (given.xy1, given.xy2))
    if cameras[0] is RAYS and typical > WIDEST_RAY:
        raise InputError(
            f"{given.path}: half of the points lie beyond {typical:.4g}, which are pixels and no rays (x/z, y/z); "
            "give the camera with --camera or --intrinsics"
        )


def join_rows(given: Given, cameras: tuple[Camera, Camera]) -> Joined:
    """The rows as patches with their matches; rows of a patch that makes no plane constrain the motion only.

    Raises
    ------
    InputError : pixels where rays are needed, a pixel that the lens sends nowhere, or no patch of three points off a
        line.
    """
    _refuse_pixels(given, cameras)
    x1, x2 = (_rays(camera, xy) for camera, xy in zip(cameras, (given.xy1, given.xy2), strict=True))
    matches = Matches(given.xy1, given.xy2, x1, x2)
    weight = np.ones(len(matches)) if given.sigma is None else (median(given.sigma) / given.sigma) ** 2
    labels = np.unique(given.patch[given.patch >= 0])
    patches = [_patch(int(label), matches, weight, given.patch == label) for label in labels]
    answered = [patch.id for patch in patches if patch.origin == "own"]
    if not answered:
        raise InputError(
            f"{given.path}: no patch has {FEWEST} rows off a line (found {len(labels)} patches in {len(x1)} rows); "
            "give the rows of a plane one number in the column patch"
        )
    outside = ~np.isin(given.patch, answered)
    return Joined.of(patches, matches.take(outside), weight[outside])


def _rays(camera: Camera, xy: FloatArray) -> FloatArray:
    x = xy if camera is RAYS else rays_from_pixels(camera, xy)
    lost = np.flatnonzero(~np.isfinite(x).all(axis=1))
    if len(lost):
        u, v = xy[lost[0]]
        raise InputError(
            f"row {lost[0] + 1}: no ray belongs to the pixel ({u:g}, {v:g}) with this lens; is it the right camera?"
        )
    return x


def _patch(label: int, matches: Matches, weight: FloatArray, mine: BoolArray) -> Patch:
    """The patch of one label with its rows (mask `mine`), or with none and the reason."""
    own = matches.take(mine)
    patch, n = Patch(label, "given", _hull(own.uv1)), len(own)
    if n < FEWEST:
        return patch.unmatched(f"it has {n} row{'s' if n > 1 else ''}, and a plane needs {FEWEST}", "too-few-points")
    spread = np.linalg.svd(own.x1 - own.x1.mean(axis=0), compute_uv=False)
    if spread[1] <= 1e-6 * spread[0]:
        return patch.unmatched(f"its {n} rows lie on one line, which does not fix a plane", "too-few-points")
    return replace(patch, matches=own, weight=weight[mine], origin="own", score=1.0, share=1.0)


def _hull(points: FloatArray) -> Hull:
    """The outline of points (n, 2), or the box around them where they have none."""
    corners = cv2.convexHull(points.astype(np.float32), returnPoints=False).ravel()
    polygon = points[corners]
    if len(polygon) < 3:
        (left, top), (right, bottom) = points.min(axis=0), points.max(axis=0)
        polygon = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    return Hull((0, 0), np.zeros((0, 0), bool), polygon)
