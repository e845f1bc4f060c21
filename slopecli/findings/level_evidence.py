"""Whether the direction taken as up is up: how much speaks for it, and for a camera that is held upright instead.

Two images know no gravity. Two explanations are compared. In the first, the direction assumed is up: the camera looks
down on ground. In the other, the camera is upright, as people and vehicles carry it, and what faces it is a facade or
a wall: up lies near the image's own up direction. Each kind of evidence adds the logarithm of how much more probable it
is under the first than under the other. The probabilities are rough, and stand where they are used.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import homogeneous, unit_vector
from slopecli.look.features import Grey
from slopecli.look.matches import ON_PLANE_PX, Evidence, gather_evidence, scene_planes, thin
from slopecli.look.noise import APART
from slopecli.look.segments import Segments, find_segments
from slopecli.measure import Measured
from slopecli.patches.join import Joined
from slopecli.patches.patch import IN_DOUBT_DEG
from slopecli.types import Camera, FloatArray, Plane, Solution

IMAGE_UP = np.array([0.0, -1.0, 0.0])
SUPPORTED = 3.0  # log odds, 20 to 1, from which on a plane that was taken as level is believed to be level
BY_DEFAULT = 2.4  # log odds, 11 to 1, that a camera looks down whose up was not given: the default is made for that
LEAST_SEGMENTS = 8
LEAST_CONCENTRATION = 0.35  # share of edges along two axes, to 4 deg, by which a scene is built of right angles


class Seen(NamedTuple):
    """Planes and points of a scene, and the edges of image 1.

    normals : (m, 3) unit normals out of the planes, camera-1 axes.  distance : (m,) from camera 1.
    area : (m,) px of image 1, or points.  points : matches consistent with the motion, with inverse depths.
    segments : None without an image.
    """

    normals: FloatArray
    distance: FloatArray
    area: FloatArray
    points: Evidence
    segments: Segments | None


class LevelOdds(NamedTuple):
    """log_odds : that the direction assumed is up; from `needed` on it is believed.

    upright : unit vector (3,), what up is otherwise.  against : what speaks against the assumption, in words.
    """

    log_odds: float
    needed: float
    upright: FloatArray
    against: tuple[str, ...]

    @property
    def doubted(self) -> bool:
        """Whether evidence speaks against it or, of a plane taken as level, too little speaks for it."""
        return self.log_odds < self.needed

    @property
    def probability(self) -> float:
        """That the direction assumed is up."""
        return 1.0 / (1.0 + math.exp(-max(min(self.log_odds, 50.0), -50.0)))


class _LevelEvidence(NamedTuple):
    """Logarithm of a ratio of probabilities, and what was seen if it is negative."""

    log_ratio: float
    words: str = ""


def level_odds(
    root: Measured, joined: Joined, planes: Sequence[Plane], camera1: Camera, grey: Grey | None
) -> LevelOdds | None:
    """How probable it is that up, as measured against, is up; None where it was given, or nothing tells.

    planes : those with an answer, lengths in baselines.  grey : image 1, None of correspondences of a user's own.
    """
    if root.up.source in ("given", "exif") or (root.level is None and grey is None):
        return None
    seen = _seen(root.solution, joined, planes, camera1, grey)
    up = np.array(root.up.vector_cam1)
    if not len(seen.points):  # no evidence either way: enough for the default, not for a plane that is taken as level
        return None if root.level is None else LevelOdds(0.0, SUPPORTED, _upright(up), ())
    if root.level is None:
        return odds_of_camera(up, seen)
    return odds_of_plane(up, 1.0 / float(np.linalg.norm(root.solution.scaled_normals[root.level])), seen)


def _seen(solution: Solution, joined: Joined, planes: Sequence[Plane], camera1: Camera, grey: Grey | None) -> Seen:
    """The planes that are well known, the matches that were kept, and the edges; without matches, no edges."""
    area = {patch.id: float(patch.footprint.area_px) for patch in joined.patches if patch.origin == "own"}
    sure = [
        one for one in planes if one.id in area and one.status == "ok" and (one.slope_sigma_deg or 0.0) < IN_DOUBT_DEG
    ]
    kept = joined.matches.take(solution.inlier)
    points = gather_evidence(kept, np.zeros(len(kept)), solution.R, solution.T, camera1.focal_px)
    return Seen(
        normals=np.array([one.normal_cam1 for one in sure]).reshape(-1, 3),
        distance=np.array([one.distance for one in sure]),
        area=np.array([area[one.id] for one in sure]),
        points=points,
        segments=None if grey is None or not len(points) else find_segments(grey, camera1),
    )


def odds_of_plane(up: FloatArray, distance: float, seen: Seen) -> LevelOdds:
    """How probable it is that a plane is level.  up : its unit normal (3,).  distance : from camera 1.

    It is compared with a facade in an upright picture, and in one that was held on either side and stored as it was
    read out, which is taken to be five times less likely. Streets and houses seen obliquely from above look much like
    the latter, so that one casts doubt only where it is the more probable of the two.
    """
    upright = _odds_against_facade(up, distance, seen, IMAGE_UP)
    odds = [upright._replace(needed=SUPPORTED)]
    for side in ([1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]):
        on_side = _odds_against_facade(up, distance, seen, np.array(side))
        odds.append(on_side._replace(log_odds=on_side.log_odds + math.log(5.0)))
    return min(odds, key=lambda one: one.log_odds - one.needed)


def _odds_against_facade(up: FloatArray, distance: float, seen: Seen, image_up: FloatArray) -> LevelOdds:
    """Odds of a level plane, beforehand even, against a facade in a picture of which `image_up` (3,) is about up."""
    edges, upright = _edges_on_plane(up, _upright(up, image_up), seen.segments)
    floor, upright_floor = _floor(upright, up, seen)
    clues = [_attitude(up, image_up), _below(up, distance, seen), edges, floor, _faces(up, upright, seen, 15.0, False)]
    return _sum(clues, 0.0, 0.0, upright if upright_floor is None else upright_floor)


def _upright(up: FloatArray, image_up: FloatArray = IMAGE_UP) -> FloatArray:
    """Unit vector (3,) at right angles to a direction, as near to the image's own up as that allows."""
    nearest = image_up if abs(up @ image_up) < 0.9 else np.array([0.0, 0.0, -1.0])
    return unit_vector(nearest - (nearest @ up) * up)


def odds_of_camera(up: FloatArray, seen: Seen) -> LevelOdds:
    """How probable it is that the camera looks straight down: up is (0, 0, -1), and was not given."""
    edges, upright = _vertical_edges(seen.segments)
    # windows need not show what stands upright, or what it stands on; a few points have planes by chance
    if edges.log_ratio < 0.0 and len(seen.points) >= 400:
        seen = _planes_of_points(seen)
    floor, upright_floor = _floor(upright, up, seen)
    clues = [edges, floor, _faces(up, upright, seen, 20.0, edges.log_ratio < 0.0)]  # hills slope by less
    odds = _sum(clues, BY_DEFAULT, 0.0, upright if upright_floor is None else upright_floor)
    # one kind of evidence against the default is not enough: streets along the image, say
    return odds if len(odds.against) > 1 else odds._replace(log_odds=max(odds.log_odds, 0.0))


def _planes_of_points(seen: Seen) -> Seen:
    """The same with the planes that most points lie on, in all of image 1 and in its lower part."""
    found: list[tuple[FloatArray, int]] = []
    for rows in (0.0, 0.6, 0.8, 0.93):
        low = np.flatnonzero(seen.points.uv1[:, 1] >= np.quantile(seen.points.uv1[:, 1], rows))
        some = seen.points.some(thin(seen.points.uv1, low, 1000))
        found += [(normal, int((some.misfit_px(normal) < ON_PLANE_PX).sum())) for normal in scene_planes(some, most=4)]
    if not found:
        return seen
    normals, counts = np.array([normal for normal, _ in found]), np.array([float(count) for _, count in found])
    length = np.linalg.norm(normals, axis=1)
    return seen._replace(normals=-normals / length[:, None], distance=1.0 / length, area=counts)


def _sum(clues: Sequence[_LevelEvidence], prior: float, needed: float, upright: FloatArray) -> LevelOdds:
    against = sorted((clue for clue in clues if clue.log_ratio < -0.3 and clue.words), key=lambda clue: clue.log_ratio)
    log_odds = prior + sum(clue.log_ratio for clue in clues)
    return LevelOdds(log_odds, needed, upright, tuple(clue.words for clue in against))


def _gauss(x: float, sigma: float) -> float:
    return math.exp(-0.5 * (x / sigma) ** 2) / (math.sqrt(2.0 * math.pi) * sigma)


def _attitude(up: FloatArray, image_up: FloatArray) -> _LevelEvidence:
    """Attitude of a camera under either explanation, as densities over the directions of the plane's normal, 1/sr.

    Looking down: straight, to 4 deg, or obliquely with a level horizon, to 8 deg. Upright: the facade faces any way
    round the vertical, and the camera is raised or lowered by 12 deg; or a rig looks at it squarely. Some do neither.
    """
    tilt, roll = math.acos(max(min(-up[2], 1.0), -1.0)), math.atan2(up[0], -up[1])
    raised = math.asin(max(min(float(up @ image_up), 1.0), -1.0))
    square = math.exp(-0.5 * (tilt / 0.07) ** 2) / (2.0 * math.pi * 0.07**2)
    oblique = _gauss(roll, 0.14) / 1.22 / max(math.sin(tilt), 0.05)  # the tilt is anything up to 70 deg
    facade = _gauss(raised, 0.21) / 2.8 / max(math.cos(raised), 0.2)  # seen from up to 80 deg to either side
    any_way = 0.1 / (2.0 * math.pi)
    log_ratio = math.log((0.3 * square + 0.6 * oblique + any_way) / (0.2 * square + 0.7 * facade + any_way))
    return _LevelEvidence(log_ratio, "the camera would be rolled, as by its own frame it is upright before a facade")


def _below(up: FloatArray, distance: float, seen: Seen) -> _LevelEvidence:
    """Nothing lies below the ground; a facade has recesses, and a street leads past it."""
    share = _share_behind(up, distance, seen)
    if share < 0.01:
        return _LevelEvidence(0.6)
    return _LevelEvidence(-1.4 if share > 0.1 else 0.0, f"{100 * share:.0f} % of what is seen lies below it")


def _share_behind(normal: FloatArray, distance: float, seen: Seen) -> float:
    """Share of the points that lie behind a plane, by more than APART of their distance."""
    rays = homogeneous(seen.points.x1)
    height = (rays @ normal + distance * seen.points.w) / np.linalg.norm(rays, axis=1)
    return float((height < -APART).mean()) if len(height) else 0.0


def _edges_on_plane(
    up: FloatArray, upright: FloatArray, segments: Segments | None
) -> tuple[_LevelEvidence, FloatArray]:
    """Edges that lie on a plane: on a facade they are vertical and horizontal, on the ground they run any way.

    Returns `upright` as well, turned onto the edges where these are vertical.
    """
    if segments is None or len(segments.length) < LEAST_SEGMENTS:
        return _LevelEvidence(0.0), upright
    along, side = np.cross(segments.normals, up), np.cross(up, upright)
    angle = np.degrees(np.arctan2(along @ side, along @ upright))
    share, peak = _peak(angle, segments.length)
    if share < LEAST_CONCENTRATION:
        return _LevelEvidence(0.0), upright
    tilt = math.degrees(math.acos(max(min(-up[2], 1.0), -1.0)))
    # seen obliquely, a facade's verticals are off the image's up by what the camera is raised
    if abs(peak) <= 6.0 + 6.0 * min(tilt / 20.0, 1.0):
        turned = math.cos(math.radians(peak)) * upright + math.sin(math.radians(peak)) * side
        return _LevelEvidence(
            _doubt_by_edges(share), "its edges run along and across the image's up direction, as a facade's do"
        ), turned
    return _LevelEvidence(min(1.5 + 10.0 * (share - LEAST_CONCENTRATION), 3.0) if tilt < 20.0 else 0.0), upright


def _peak(angle_deg: FloatArray, weight: FloatArray) -> tuple[float, float]:
    """Share of the weight within 4 deg of two directions at right angles, and the angle of the first, -45..45.

    angle_deg : of the edges. The share is 0 where either direction has less than 6 % of it, as rows on a field.
    """
    counts = np.bincount((angle_deg % 90.0).astype(int) % 90, weight, 90)
    sums = np.convolve(np.r_[counts[-4:], counts, counts[:4]], np.ones(9), "valid")
    peak = int(sums.argmax())
    off = (angle_deg - peak - 0.5 + 45.0) % 180.0 - 45.0  # from the first direction: around 0, or around 90
    first, second = (float(weight[np.abs(off - at) < 4.5].sum() / max(weight.sum(), 1e-9)) for at in (0.0, 90.0))
    return (first + second if min(first, second) > 0.06 else 0.0), float(peak if peak < 45 else peak - 90)


def _doubt_by_edges(share: float) -> float:
    """Log ratio of edges that run along and across the image's up: -1 to -2.8 as they are 35 to 80 % of all.

    Of pictures from above few have such edges, and of these one in four runs along the image; most of facades do.
    """
    return float(np.interp(share, [LEAST_CONCENTRATION, 0.5, 0.8], [-1.0, -2.0, -2.8]))


def _vertical_edges(segments: Segments | None) -> tuple[_LevelEvidence, FloatArray]:
    """Edges that converge to a vertical vanishing point within 30 deg of the image's up, and horizontal ones.

    Of edges that run any way, 1 in 20 does so. Returns that vanishing point's direction as well.
    """
    if segments is None or len(segments.length) < LEAST_SEGMENTS:
        return _LevelEvidence(0.0), IMAGE_UP
    pitch, roll = np.meshgrid(np.radians(np.arange(-30, 31, 3)), np.radians(np.arange(-6, 7, 3)))
    ways = np.stack([np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch), np.sin(pitch)], axis=-1).reshape(
        -1, 3
    )
    upright = ways[int(segments.length_towards(ways, 2.0).argmax())]
    # directions of edges as seen in the image; horizontal and vertical ones dominate what was built upright
    angle = np.degrees(np.arctan2(segments.normals[:, 1], segments.normals[:, 0]))
    share, peak = _peak(angle, segments.length)
    if share < LEAST_CONCENTRATION or abs(peak) > 6.0:
        return _LevelEvidence(0.0), upright
    return _LevelEvidence(
        _doubt_by_edges(share),
        "edges of the image are vertical and horizontal, as those of a facade before an upright camera",
    ), upright


def _floor(upright: FloatArray, up: FloatArray, seen: Seen) -> tuple[_LevelEvidence, FloatArray | None]:
    """A plane that faces `upright` to 20 deg and below which nothing lies: the ground before an upright camera.

    Returns its normal as well, None without one. A house seen from above has no such wall: its roof lies behind it.
    """
    faces_up = (seen.normals @ upright > math.cos(math.radians(20.0))) & (np.abs(seen.normals @ up) < 0.5)
    for k in np.flatnonzero(faces_up & (seen.area >= 0.02 * seen.area.sum())):
        if _share_behind(seen.normals[k], float(seen.distance[k]), seen) < 0.03:
            words = "a plane at right angles to it lies below everything else in view, as the ground does"
            return _LevelEvidence(-2.5, words), seen.normals[k]
    return _LevelEvidence(0.0), None


def _faces(up: FloatArray, upright: FloatArray, seen: Seen, least_deg: float, by_edges: bool) -> _LevelEvidence:
    """Which way the other planes face: hardly anything faces down, seen from an upright camera; walls face sideways.

    Walls and roofs that are seen from above face every way, and rather towards the camera.  least_deg : from up, of
    planes that count.  by_edges : whether `upright` is where edges converge; else it is known to 10 deg.
    """
    other = seen.normals @ up < math.cos(math.radians(least_deg))
    normals, area = seen.normals[other], seen.area[other]
    if not len(normals) or area.sum() < 0.005 * seen.area.sum():
        return _LevelEvidence(0.0)
    rise = normals @ upright
    wall = np.abs(rise) < (0.05 if by_edges else 0.17)  # upright to 3 deg, or to 10
    log_ratio = np.where(rise < -0.17, math.log(0.4 / 0.04), np.where(wall, math.log(0.3 / 0.7), 0.14))
    mean = float(area @ log_ratio / area.sum())
    # the sides of a niche lean both ways as well, to a camera before it, but are upright
    both_ways = 1.5 if _lean_both_ways(up, normals[~wall] if by_edges else normals) else 0.0
    words = "what is not level by it faces sideways, as walls round an upright camera do"
    return _LevelEvidence(mean * min(_distinct(normals, area), 3) + both_ways, words)


def _lean_both_ways(up: FloatArray, normals: FloatArray) -> bool:
    """Whether two planes of 15 to 55 deg lean equally to opposite sides, as the two halves of a roof do."""
    pitched = normals[normals @ up > math.cos(math.radians(55.0))]
    mirrored = 2.0 * (pitched @ up)[:, None] * up - pitched
    return bool((pitched @ mirrored.T > math.cos(math.radians(10.0))).any())


def _distinct(normals: FloatArray, area: FloatArray) -> int:
    """Number of directions, 20 deg apart, among normals (m, 3), the largest areas first."""
    kept: list[FloatArray] = []
    for k in np.argsort(-area):
        if all(normals[k] @ one < math.cos(math.radians(20.0)) for one in kept):
            kept.append(normals[k])
    return len(kept)
