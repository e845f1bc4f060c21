"""The joint problem as the test of the cameras sees it, and the same matches as other cameras see them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slopecli.geometry.camera import rays_from_pixels
from slopecli.geometry.solver.seen_points import Sightings, thinned, together
from slopecli.look.matches import MIN_ON_PLANE, Matches, thin
from slopecli.look.scene import Scene
from slopecli.patches.join import OUTSIDE_POINTS, Joined, outside_weight
from slopecli.patches.patch import Patch
from slopecli.types import BoolArray, Camera, Solution


def sightings_of(joined: Joined, solution: Solution, cameras: tuple[Camera, Camera]) -> Sightings:
    """The correspondences that a solution kept, at most a few thousand."""
    kept = solution.inlier
    return thinned(_of_matches(joined, cameras, 1.0).take(kept), gain=solution.noise_gain)


def _of_matches(joined: Joined, cameras: tuple[Camera, Camera], gain: float) -> Sightings:
    matches = joined.matches
    rays = matches.x1, matches.x2
    return Sightings(matches.uv1, matches.uv2, joined.plane, joined.weight, cameras, gain, rays)


def every_sighting(joined: Joined, cameras: tuple[Camera, Camera], gain: float, scene: Scene | None) -> Sightings:
    """All correspondences, and cells of the overview: what a solution under wrong cameras left out may fit others.

    Matches of windows were chosen under the cameras given; the overview was not.
    """
    every = _of_matches(joined, cameras, gain)
    if scene is None:
        return every
    cells = scene.cells
    some = thin(cells.uv1, np.flatnonzero(cells.textured), OUTSIDE_POINTS)
    weight = outside_weight(scene, len(some))
    outside = Sightings(cells.uv1[some], cells.uv2[some], np.full(len(some), -1), weight, cameras, gain)
    return together(every, outside.with_rays())


def seen_by(joined: Joined, cameras: tuple[Camera, Camera]) -> Joined:
    """The same matched pixels of other cameras; those that have no ray in one of these lenses are left out."""
    patches = [_seen_by(patch, cameras) if patch.origin != "none" else patch for patch in joined.patches]
    on_none = joined.plane < 0
    outside, kept = _rays(joined.matches.take(on_none), cameras)
    every = [*patches, *joined.unanswered]
    return Joined.of(every, outside.take(kept), joined.weight[on_none][kept], joined.segmentation)


def _seen_by(patch: Patch, cameras: tuple[Camera, Camera]) -> Patch:
    matches, kept = _rays(patch.matches, cameras)
    if kept.all():
        return replace(patch, matches=matches)
    if kept.sum() < MIN_ON_PLANE:
        return patch.unmatched("the camera has no ray for most of its matches")
    cell = patch.cell[kept] if len(patch.cell) == len(kept) else patch.cell
    return replace(patch, matches=matches.take(kept), weight=patch.weight[kept], cell=cell)


def _rays(matches: Matches, cameras: tuple[Camera, Camera]) -> tuple[Matches, BoolArray]:
    """The matches with the rays of other cameras, and (n,) which have one in both."""
    x1, x2 = (rays_from_pixels(c, uv) for c, uv in zip(cameras, (matches.uv1, matches.uv2), strict=True))
    return replace(matches, x1=x1, x2=x2), np.asarray(np.isfinite(x1).all(axis=1) & np.isfinite(x2).all(axis=1))
