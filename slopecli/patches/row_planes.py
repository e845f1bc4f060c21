"""Which plane a user's own correspondences lie on, where their file does not say: functions from `Given` to `Given`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.geometry.camera import rays_from_pixels
from slopecli.patches.given import RAYS, Given
from slopecli.patches.uncalibrated.correspondence_labels import label_planes
from slopecli.types import Camera, FloatArray, IntArray
from slopecli.windows import Window, inside_window, window_polygon


def rows_on_one_plane(given: Given) -> Given:
    """All rows on plane 1."""
    return _with(given, np.ones(len(given.xy1), np.int64), {"planes": "one"})


def rows_by_label_planes(given: Given, cameras: tuple[Camera, Camera] | None, seed: int) -> Given:
    """Rows on the planes that `label_planes` finds among them, 1 the one with most rows; those on none are left out.

    Nothing tells points of no plane from mismatches, which would spoil the motion.

    cameras : of both images, whose lens distortion is removed first, as it bends planes; None for rays.

    Raises
    ------
    NoAnswer : there is no plane.
    """
    both = cameras or (RAYS, RAYS)
    flat1, flat2 = (_undistorted(xy, camera) for xy, camera in zip((given.xy1, given.xy2), both, strict=True))
    seen = np.isfinite(np.hstack([flat1, flat2])).all(axis=1)  # `join_rows` names a row without a ray
    patch = np.full(len(given.xy1), -1)
    patch[seen] = label_planes(flat1[seen], flat2[seen], seed)
    patch[patch >= 0] += 1
    if patch.max(initial=-1) < 1:
        raise NoAnswer(
            "low-texture",
            f"none of the {len(patch)} rows of {given.name} lie on a common plane",
            "give more rows, or say which lie on one plane: --planes one, a column patch, --window, --grid or --labels",
        )
    on = (patch >= 0) | ~seen
    sigma = given.sigma[on] if given.sigma is not None else None
    left_out = f"{np.count_nonzero(~on)} of {len(on)} rows lie on none of the planes found and are not used"
    note = "; ".join(filter(None, [given.note, left_out if not on.all() else ""]))
    kept = replace(given, xy1=given.xy1[on], xy2=given.xy2[on], sigma=sigma, note=note)
    return _with(kept, patch[on], {"planes": "found", "seed": seed})


def rows_in_windows(given: Given, windows: Sequence[Window], options: Mapping[str, object]) -> Given:
    """Rows by the window of image 1 that they lie in, 1 the first; -1 for those in none.

    options : how the windows were given, for slopes.json.

    Raises
    ------
    InputError : a row lies in two windows.
    """
    inside = np.array([inside_window(given.xy1, window) for window in windows])
    both = np.flatnonzero(inside.sum(axis=0) > 1)
    if len(both):
        first, second = (np.flatnonzero(inside[:, both[0]])[:2] + 1).tolist()
        u, v = given.xy1[both[0]]
        raise given.refusal(
            f"the point ({u:g}, {v:g}) lies in windows {first} and {second}; "
            "let windows not overlap, as a row lies on one plane"
        )
    patch = np.where(inside.any(axis=0), inside.argmax(axis=0) + 1, -1)
    outlines = {number: window_polygon(window) for number, window in enumerate(windows, 1)}
    return replace(_with(given, patch, options), outlines=outlines)


def rows_by_label_image(given: Given, labels: IntArray, path: str) -> Given:
    """Rows by the number of the pixel of image 1 nearest to their point; -1 where that is 0, or outside.

    labels : (h, w) numbers of planes.  path : of their file, for slopes.json.
    """
    u, v = np.rint(given.xy1).astype(np.int64).T
    height, width = labels.shape
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    number = labels[np.clip(v, 0, height - 1), np.clip(u, 0, width - 1)]
    return _with(given, np.where(inside & (number > 0), number, -1), {"planes": "labels", "labels": path})


def _undistorted(xy: FloatArray, camera: Camera) -> FloatArray:
    """(n, 2) px, or mrad of rays, without lens distortion; NaN where a pixel has no ray."""
    return 1e3 * xy if camera is RAYS else rays_from_pixels(camera, xy) * camera.focal_px


def _with(given: Given, patch: IntArray, options: Mapping[str, object]) -> Given:
    return replace(given, patch=patch, options=options)
