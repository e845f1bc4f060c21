"""A town seen twice from about 60 m, obliquely, a lateral step apart, and the truth about both images.

Every ray is intersected with every polygon in front of it in closed form and the nearest hit is kept, so that the
geometry is exact to rounding; sun shadows are ray casts too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rendering import (
    FloatArray,
    View,
    angle_deg,
    area_filter,
    develop,
    motion_truth,
    rotation_about,
    subpixel_offsets,
)
from town import SEED, Face, Town, Tree, build_town

SUPERSAMPLING = 3
STRIP = 50  # image rows rendered at a time, to bound memory
SUN_AZIMUTH_DEG, SUN_ELEVATION_DEG = -62.0, 46.0  # from east towards north
SUN, SKY, BOUNCE = np.array([2.05, 1.93, 1.70]), np.array([0.40, 0.46, 0.56]), np.array([0.16, 0.14, 0.12])
EXPOSURE = 1.0
OCCLUSION_TOLERANCE = 1e-6  # relative depth
SMALLEST_PLANE = 400  # px; smaller ones are not listed


@dataclass(frozen=True, eq=False)
class Hits:
    """For each ray (n,): depth, and which face (>= 0), tree (-2 - index) or nothing (-1) it meets; normals of trees."""

    depth: FloatArray
    target: NDArray[np.int64]
    normal: FloatArray


def trace(town: Town, view: View, u: FloatArray, v: FloatArray) -> Hits:
    """First hits of the rays of pixels u, v (n,)."""
    directions = view.rays(u, v)
    hits = Hits(np.full(len(u), np.inf), np.full(len(u), -1), np.zeros((len(u), 3)))
    rows = v.min() - 1, v.max() + 1
    for index, face in enumerate(town.faces):
        if face.normal @ (view.centre - face.origin) > 0:
            trace_face(face, index, view, u, v, rows, directions, hits)
    for index, tree in enumerate(town.trees):
        trace_tree(tree, -2 - index, view, u, v, rows, directions, hits)
    return hits


def in_box(
    u: FloatArray, v: FloatArray, rows: tuple[float, float], us: FloatArray, vs: FloatArray, margin: float = 0.0
) -> NDArray[np.int64]:
    """Indices of the rays inside the bounding box of projected points; quickly none outside the strip's rows."""
    if vs.max() + margin < rows[0] or vs.min() - margin > rows[1]:
        return np.empty(0, dtype=np.int64)
    inside = (u >= us.min() - margin) & (u <= us.max() + margin) & (v >= vs.min() - margin) & (v <= vs.max() + margin)
    return np.flatnonzero(inside)


def trace_face(
    face: Face, index: int, view: View, u: FloatArray, v: FloatArray, rows: tuple[float, float],
    directions: FloatArray, hits: Hits,
) -> None:  # fmt: skip
    """Enter a face where it is nearer than what is known."""
    us, vs, depths = view.project(face.corners)
    rays = in_box(u, v, rows, us, vs) if depths.min() > 0 else np.arange(len(u))
    with np.errstate(divide="ignore"):
        depth = (face.normal @ (face.origin - view.centre)) / (directions[rays] @ face.normal)
    nearer = (depth > 0) & (depth < hits.depth[rays])
    rays, depth = rays[nearer], depth[nearer]
    points = face.coordinates(view.centre + depth[:, None] * directions[rays])
    inside = in_polygon(points, face.coordinates(face.corners))
    hits.depth[rays[inside]], hits.target[rays[inside]] = depth[inside], index


def in_polygon(points: FloatArray, corners: FloatArray) -> NDArray[np.bool_]:
    """Which points (n, 2) lie in a convex counter-clockwise polygon (k, 2)."""
    inside = np.ones(len(points), dtype=bool)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge = b - a
        inside &= edge[0] * (points[:, 1] - a[1]) >= edge[1] * (points[:, 0] - a[0])
    return inside


def trace_tree(
    tree: Tree, target: int, view: View, u: FloatArray, v: FloatArray, rows: tuple[float, float],
    directions: FloatArray, hits: Hits,
) -> None:  # fmt: skip
    """Enter a tree's leaf balls where they are nearer than what is known."""
    us, vs, depths = view.project(tree.centres)
    margins = 1.1 * view.focal * tree.radii / depths
    crown = in_box(u, v, rows, us, vs, margins.max())
    for centre, radius, uc, vc, margin in zip(tree.centres, tree.radii, us, vs, margins, strict=True):
        rays = crown[(np.abs(u[crown] - uc) < margin) & (np.abs(v[crown] - vc) < margin)]
        offset, d = view.centre - centre, directions[rays]
        a, b, c = np.sum(d * d, axis=1), d @ offset, offset @ offset - radius**2
        with np.errstate(invalid="ignore"):
            depth = (-b - np.sqrt(b * b - a * c)) / a
            nearer = depth < hits.depth[rays]
        rays, depth = rays[nearer], depth[nearer]
        hits.depth[rays], hits.target[rays] = depth, target
        hits.normal[rays] = (offset + depth[:, None] * d[nearer]) / radius


def sun_direction() -> FloatArray:
    azimuth, elevation = np.deg2rad([SUN_AZIMUTH_DEG, SUN_ELEVATION_DEG])
    return np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])


def in_shadow(town: Town, points: FloatArray, own_solid: int) -> NDArray[np.bool_]:
    """Which points (n, 3) of a face of a solid have something between them and the sun."""
    sun = sun_direction()
    across = np.linalg.svd(sun[None, :])[2][1:]
    seen_from_sun = points @ across.T
    dark = np.zeros(len(points), dtype=bool)
    for solid, (corners, planes) in enumerate(zip(town.corners, town.half_spaces, strict=True)):
        if solid != own_solid:
            near = candidates(seen_from_sun, corners @ across.T, ~dark)
            dark[near] = meets_solid(points[near], sun, *planes)
    for tree in town.trees:
        near = candidates(seen_from_sun, tree.centres @ across.T, ~dark, tree.radii.max())
        dark[near] = meets_tree(points[near], seen_from_sun[near], sun, across, tree)
    return dark


def candidates(
    points: FloatArray, outline: FloatArray, wanted: NDArray[np.bool_], margin: float = 0.0
) -> NDArray[np.int64]:
    """Indices of the wanted points (n, 2) in the bounding box of an outline (k, 2)."""
    low, high = outline.min(axis=0) - margin, outline.max(axis=0) + margin
    x, y = points.T
    return np.flatnonzero(wanted & (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1]))


def meets_solid(points: FloatArray, ray: FloatArray, normals: FloatArray, offsets: FloatArray) -> NDArray[np.bool_]:
    """Whether rays from points (n, 3) pass through a convex solid, by clipping them at its half-spaces."""
    entry, leave = np.full(len(points), 1e-4), np.full(len(points), np.inf)
    for normal, offset in zip(normals, offsets, strict=True):
        gap, rate = offset - points @ normal, float(normal @ ray)
        if abs(rate) < 1e-12:
            leave[gap < 0] = -np.inf
        elif rate > 0:
            leave = np.minimum(leave, gap / rate)
        else:
            entry = np.maximum(entry, gap / rate)
    return leave > entry + 1e-6


def meets_tree(
    points: FloatArray, seen: FloatArray, sun: FloatArray, across: FloatArray, tree: Tree
) -> NDArray[np.bool_]:
    """Whether a leaf ball lies between points (n, 3), at (n, 2) as seen from the sun, and the sun."""
    dark = np.zeros(len(points), dtype=bool)
    height = points @ sun
    for centre, radius in zip(tree.centres, tree.radii, strict=True):
        dx, dy = (seen - across @ centre).T
        dark |= (dx * dx + dy * dy < radius**2) & (centre @ sun - height > 0.6 * radius)
    return dark


def shade(town: Town, points: FloatArray, normals: FloatArray, solid: int) -> FloatArray:
    """Light (n, 3) that falls on points (n, 3): sun, sky, and what the ground sends back."""
    cosine = np.clip(normals @ sun_direction(), 0, None)
    lit = np.flatnonzero(cosine > 0)
    cosine[lit[in_shadow(town, points[lit], solid)]] = 0
    facing_up = 0.5 + 0.5 * normals[:, 2]
    ambient = facing_up[:, None] * SKY + (1 - facing_up)[:, None] * BOUNCE
    return cosine[:, None] * SUN + ambient * openness(town, points)[:, None]


def openness(town: Town, points: FloatArray, reach: float = 7.0) -> FloatArray:
    """How much of the sky (n,) is left near the ground beside buildings."""
    hidden = np.zeros(len(points))
    for centre, azimuth, half_length, half_width in town.footprints:
        c, s = np.cos(np.deg2rad(azimuth)), np.sin(np.deg2rad(azimuth))
        limit = half_length + half_width + reach
        near = candidates(points[:, :2], np.array([centre - limit, centre + limit]), points[:, 2] < reach)
        x, y = np.abs((points[near, :2] - centre) @ np.array([[c, -s], [s, c]])).T
        distance = np.hypot(np.clip(x - half_length, 0, None), np.clip(y - half_width, 0, None))
        hidden[near] = np.maximum(hidden[near], np.exp(-distance / 1.6))
    return 1 - 0.5 * hidden * np.exp(-np.clip(points[:, 2], 0, None) / 1.5)


def colours(town: Town, view: View, u: FloatArray, v: FloatArray) -> FloatArray:
    """Radiance (n, 3), RGB, that pixels u, v (n,) receive."""
    hits = trace(town, view, u, v)
    points = view.centre + hits.depth[:, None] * view.rays(u, v)
    radiance = np.zeros((len(u), 3))
    for target in np.unique(hits.target):
        rays = np.flatnonzero(hits.target == target)
        if target >= 0:
            face = town.faces[target]
            s, t = face.coordinates(points[rays]).T
            normals, solid = np.broadcast_to(face.normal, (len(rays), 3)), face.solid
            albedo = face.material(face.surface, s, t)
        else:
            tree = town.trees[-2 - target]
            x, y, z = points[rays].T
            normals, solid = hits.normal[rays], -1
            albedo = tree.material(tree.surface, x + 0.5 * z, y - 0.7 * z)
        radiance[rays] = albedo * shade(town, points[rays], normals, solid)
    return radiance


def render_view(town: Town, view: View) -> FloatArray:
    """Radiance image (h, w, 3), RGB."""
    offsets = subpixel_offsets(SUPERSAMPLING)
    u = (np.arange(view.width)[:, None] + offsets).ravel()
    strips = []
    for top in range(0, view.height, STRIP):
        v = (np.arange(top, min(top + STRIP, view.height))[:, None] + offsets).ravel()
        us, vs = (grid.ravel() for grid in np.meshgrid(u, v))
        strips.append(colours(town, view, us, vs).reshape(len(v), len(u), 3))
    return area_filter(np.concatenate(strips), SUPERSAMPLING)


def urban_views() -> tuple[View, View]:
    """Two oblique views of the crossing, 6 m apart sideways, the second turned back towards the middle."""
    focal = float(400 / np.tan(np.deg2rad(25)))
    first = look_at(np.array([0.0, 2.0, 0.0]), distance=62.0, heading_deg=28.0, off_nadir_deg=41.0)
    turn = rotation_about("z", 0.7) @ rotation_about("y", 2.1) @ rotation_about("x", -0.5)
    centre = first[1] + first[0].T @ np.array([6.1, -0.4, 0.6])
    return View(800, 600, focal, *first), View(800, 600, focal, turn @ first[0], centre)


def look_at(
    target: FloatArray, distance: float, heading_deg: float, off_nadir_deg: float
) -> tuple[FloatArray, FloatArray]:
    """Rotation and centre of a camera that sees a target from a distance, heading from north towards east."""
    heading, angle = np.deg2rad([heading_deg, off_nadir_deg])
    right = np.array([np.cos(heading), -np.sin(heading), 0.0])
    ahead = np.array([np.sin(heading), np.cos(heading), 0.0])
    forward = np.sin(angle) * ahead - np.cos(angle) * np.array([0.0, 0.0, 1.0])
    return np.stack([right, np.cross(forward, right), forward]), target - distance * forward


def plane_labels(town: Town, target: NDArray[np.int64]) -> tuple[NDArray[np.uint8], list[Face]]:
    """Label image of the planes large enough to list, largest first from 1, and one face of each."""
    names = np.array([face.plane for face in town.faces] + [""])
    name = np.where(target >= 0, names[target], "")
    found, counts = np.unique(name[name != ""], return_counts=True)
    order = np.argsort(-counts, kind="stable")
    listed = [str(found[k]) for k in order if counts[k] >= SMALLEST_PLANE]
    labels = np.zeros(target.shape, dtype=np.uint8)
    for label, plane in enumerate(listed, 1):
        labels[name == plane] = label
    return labels, [next(face for face in town.faces if face.plane == plane) for plane in listed]


def visible_from(town: Town, view: View, points: FloatArray) -> NDArray[np.bool_]:
    """Which points (n, 3) a view sees: inside its image and not hidden."""
    u, v, depth = view.project(points)
    seen = view.contains(u, v)
    found = trace(town, view, u[seen], v[seen]).depth
    seen[seen] = np.abs(found - depth[seen]) < OCCLUSION_TOLERANCE * depth[seen]
    return seen


def render_urban() -> tuple[list[NDArray[np.uint8]], dict[str, Any], dict[str, Any], NDArray[np.uint8]]:
    """Both images (BGR), the camera file, the truth and the label image."""
    town = build_town()
    first, second = urban_views()
    noise = np.random.default_rng(SEED + 1)
    images = [develop(render_view(town, view), EXPOSURE, noise)[..., ::-1] for view in (first, second)]
    u, v = (grid.ravel().astype(float) for grid in np.meshgrid(np.arange(first.width), np.arange(first.height)))
    hits = trace(town, first, u, v)
    seen = visible_from(town, second, first.centre + hits.depth[:, None] * first.rays(u, v))
    labels, faces = plane_labels(town, hits.target)
    truth = {**motion_truth(first, second), "planes": planes_truth(first, labels, faces, seen)}
    return images, first.camera_file(), truth, labels.reshape(first.height, first.width)


def planes_truth(
    view: View, labels: NDArray[np.uint8], faces: list[Face], seen: NDArray[np.bool_]
) -> list[dict[str, Any]]:
    """The listed planes in camera-1 axes, as truth.json has them."""
    planes = []
    for label, face in enumerate(faces, 1):
        pixels = labels == label
        normal = view.rotation @ face.normal
        planes.append(
            {
                "id": label,
                "name": face.plane,
                "normal_cam1": normal.round(12).tolist(),
                "distance_m": round(float(face.normal @ (view.centre - face.origin)), 9),
                "slope_deg": round(angle_deg(normal, view.rotation[:, 2]), 9),
                "pixels": int(pixels.sum()),
                "visible_fraction": round(float(seen[pixels].mean()), 6),
            }
        )
    return planes
