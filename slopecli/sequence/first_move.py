"""Solve the first pair of a sequence: the reference and the first later frame with enough parallax.

The motion comes from features; the points of all windows are aligned under it, then under planes through them; the
joint solution of these points has every root that they leave.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np

from slopecli.errors import SlopemapError
from slopecli.findings.parallax import LOW_PARALLAX_PX
from slopecli.geometry.epipolar import fit_rotation, homogeneous
from slopecli.geometry.motion import MotionEstimate, inverse_depth, refine_motion
from slopecli.geometry.plane_fit import robust_plane
from slopecli.geometry.solver.solve import solve_planes
from slopecli.geometry.statistics import MAD_FACTOR, median
from slopecli.look.features import EFFORTS, QUICK, FeatureMemory, Grey, Images, match_sift
from slopecli.look.matches import LEAST_MATCHES, thin
from slopecli.look.motions import Sparse, find_motions
from slopecli.look.noise import LEAST_MATCH_PX, WORST_MATCH_PX
from slopecli.sequence.frame_alignment import Aligner, Found
from slopecli.sequence.frame_gates import FrameGates, Skipped
from slopecli.types import Camera, FloatArray, IntArray, Solution


class FirstMove(NamedTuple):
    """Where the second frame shows the points, which are on planes as solved, and the solution."""

    found: Found
    solution: Solution


def first_move(
    reference: Grey, frame: Grey, camera: Camera, aligner: Aligner, memory: FeatureMemory, gates: FrameGates
) -> FirstMove | Skipped:
    """The pair of the reference and the first frame with enough parallax, or why there is none yet."""
    sparse = _matched(Images(reference, frame, camera, camera), memory)
    if sparse is None:
        return gates.blur_alone(frame) or Skipped("foreign", "has no clear matches with the first frame")
    matches = sparse.matches.take(sparse.consistent_with(sparse.motions[0]))
    R = fit_rotation(homogeneous(matches.x1).T, matches.x2.T, np.ones(len(matches)))
    y = R @ homogeneous(matches.x1).T
    parallax = median(np.hypot(*(y[:2] / y[2] - matches.x2.T))) * camera.focal_px
    if parallax < LOW_PARALLAX_PX:
        return Skipped("parallax", f"moved too little for a first answer: {parallax:.1f} px of parallax")
    try:
        return _solved(frame, sparse, camera, aligner, gates)
    except SlopemapError as problem:
        return Skipped("parallax", str(problem))


def _solved(frame: Grey, sparse: Sparse, camera: Camera, aligner: Aligner, gates: FrameGates) -> FirstMove | Skipped:
    """Points aligned under the best motion, then under the planes they give, and the joint solution."""
    tracks, best = aligner.tracks, sparse.motions[0]
    normals, u = _first_depths(sparse, best, aligner)
    known = np.ones(len(tracks), bool)
    found = aligner.find(frame, (best.R, best.T), normals, u, known, levels=2)
    if _shown(aligner, found) == 0:
        return Skipped("foreign", "shows no window of the first frame")
    x1, x2, focal_px = tracks.p[:2, found.seen].T, found.x[:, found.seen].T, camera.focal_px
    near = refine_motion(best.R, best.T, x1, x2, (LEAST_MATCH_PX / focal_px, WORST_MATCH_PX / focal_px))
    depth = u.copy()
    depth[found.seen] = inverse_depth(near.R, near.T, x1, x2)[0]
    # a track that went astray is where the features around it put it
    depth = np.where(np.abs(depth - u) < 0.2 * np.abs(u), depth, u)
    found = aligner.find(frame, (near.R, near.T), normals, depth, known, levels=1)
    if _shown(aligner, found) == 0:
        return Skipped("foreign", "shows no window of the first frame")
    if (blurred := gates.blur(found.detail)) is not None:
        return blurred
    solution = _pair(aligner, found, [near, *sparse.roots()[1:]])
    if solution.noise * focal_px > WORST_MATCH_PX or not solution.converged:
        return Skipped("foreign", f"fits no motion: its points are {solution.noise * focal_px:.1f} px off")
    return FirstMove(found, solution)


def _shown(aligner: Aligner, found: Found) -> int:
    """Number of windows with enough points in the frame."""
    tracks = aligner.tracks
    count = np.bincount(tracks.patch[found.seen & (tracks.patch >= 0)], minlength=len(tracks.cells))
    return int(np.count_nonzero(count >= LEAST_MATCHES))


def _matched(images: Images, memory: FeatureMemory) -> Sparse | None:
    """Features of both frames that agree on a motion: those of small images suffice where most do; None if few do."""
    for effort, enough in ((QUICK, 60), (EFFORTS[0], 40)):
        sparse = find_motions(images, [partial(match_sift, effort=effort, memory=memory)], thorough=False)
        if sparse.motions and sparse.n_inliers >= max(enough, 0.5 * len(sparse.matches)):
            return sparse
    return None


def _first_depths(sparse: Sparse, best: MotionEstimate, aligner: Aligner) -> tuple[FloatArray, FloatArray]:
    """One plane through the features for all windows (m, 3), and inverse depths (n,) with what features are off it."""
    tracks = aligner.tracks
    consistent = np.flatnonzero(sparse.consistent_with(best))
    matches = sparse.matches.take(thin(sparse.matches.uv1, consistent, 400))
    w, leverage = inverse_depth(best.R, best.T, matches.x1, matches.x2)
    fine = w > 0.0
    plane = robust_plane(matches.x1[fine], w[fine], leverage[fine], LEAST_MATCH_PX / sparse.focal_px).normal
    off = w[fine] - homogeneous(matches.x1[fine]) @ plane
    limit = 3.0 * MAD_FACTOR * median(np.abs(off))
    # the mean of a few features around: their relief is that of the point, their noise is averaged
    places, points = (np.ascontiguousarray(x, np.float32) for x in (matches.x1[fine], tracks.p[:2].T))
    nearest = cv2.batchDistance(points, places, cv2.CV_32F, K=min(5, len(places)))[1]
    u = plane @ tracks.p + np.median(np.clip(off, -limit, limit)[nearest], axis=1)
    return np.repeat(plane[None], len(tracks.cells), axis=0), np.asarray(u)


def _pair(aligner: Aligner, found: Found, roots: list[MotionEstimate]) -> Solution:
    """The joint solution of the points seen, windows with too few of them on the plane of all."""
    tracks, seen = aligner.tracks, found.seen
    patch = tracks.patch[seen]
    count = np.bincount(patch[patch >= 0], minlength=len(tracks.cells))
    whole = np.flatnonzero(count >= LEAST_MATCHES)
    number = np.full(len(tracks.cells), -1)
    number[whole] = np.arange(len(whole))
    labels = np.where(patch >= 0, number[np.maximum(patch, 0)], -1)
    x1, x2 = tracks.p[:2, seen].T, found.x[:, seen].T
    solution = solve_planes(x1, x2, labels, relief=True, initial=[(root.R, root.T) for root in roots])
    return _for_all_windows(solution, whole, len(tracks.cells))


def _for_all_windows(solution: Solution, whole: IntArray, m: int) -> Solution:
    """The solution with a plane for every window: of one that was not solved the mean of the others."""

    def widened(one: Solution) -> Solution:
        normals = np.repeat(one.scaled_normals.mean(axis=0)[None], m, axis=0)
        relief = np.full(m, float(np.median(one.relief)))
        normals[whole], relief[whole] = one.scaled_normals, one.relief
        return replace(one, scaled_normals=normals, relief=relief)

    other = solution.ambiguity.alternative
    ambiguity = replace(solution.ambiguity, alternative=None if other is None else widened(other))
    return replace(widened(solution), ambiguity=ambiguity)
