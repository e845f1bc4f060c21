"""A landing site seen twice while descending from 15 m to 13 m, and the truth about both images.

Image 1, whose ground is judged, is the later one: all it shows is in the earlier one, too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from heightfield import RayCaster
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
    total_least_squares_plane,
)
from terrain import ALTITUDE, CELL, SEED, build_terrain

Window = tuple[int, int, int, int]  # x, y, w, h in px

SUPERSAMPLING = 3  # odd: the middle sub-sample is the pixel centre, where the truth is taken
STRIP = 80  # image rows rendered at a time, to bound memory
OCCLUSION_TOLERANCE = 0.02  # m
SMOOTH_WINDOW = 140  # px
DISC, DISC_STEP, DISC_FIRST = 50, 6, 2  # px: footprints of a slope map are such discs around every sixth pixel from 2
EXPOSURE_1, EXPOSURE_2 = 1.35, 1.44


def descent_views() -> tuple[View, View]:
    """Camera 1 looks straight down, x to the east; camera 2 was higher, 0.85 m aside, its attitude 2.4 deg other."""
    focal = float(400 / np.tan(np.deg2rad(30)))
    down = np.diag([1.0, -1.0, -1.0])
    turn = rotation_about("z", 1.3) @ rotation_about("y", 1.7) @ rotation_about("x", 1.1)
    first, second = np.array([0.0, 0.0, ALTITUDE]), np.array([0.72, 0.46, ALTITUDE + 2.0])
    lens = (-0.06, 0.012)
    return View(800, 800, focal, down, first, lens), View(800, 800, focal, turn @ down, second, lens)


def render_view(view: View, caster: RayCaster, radiance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Radiance image (h, w) and the world points (h, w, 3) at the pixel centres."""
    offsets = subpixel_offsets(SUPERSAMPLING)
    u = (np.arange(view.width)[:, None] + offsets).ravel()
    centres = slice(SUPERSAMPLING // 2, None, SUPERSAMPLING)
    samples, points = [], []
    for top in range(0, view.height, STRIP):
        v = (np.arange(top, min(top + STRIP, view.height))[:, None] + offsets).ravel()
        directions = view.rays(*np.meshgrid(u, v))
        shape, rays = directions.shape, directions.reshape(-1, 3)
        hits = view.centre + caster.depth(view.centre, rays)[:, None] * rays
        samples.append(caster.sample(radiance, hits[:, 0], hits[:, 1]).reshape(shape[:2]))
        points.append(hits.reshape(shape)[centres, centres])
    return area_filter(np.concatenate(samples), SUPERSAMPLING), np.concatenate(points)


def visible_from(view: View, caster: RayCaster, points: FloatArray) -> NDArray[np.bool_]:
    """Which surface points (h, w, 3) a view sees: inside its image and not hidden."""
    u, v, depth = view.project(points)
    seen = view.contains(u, v)
    rays = (points[seen] - view.centre) / depth[seen][:, None]
    seen[seen] = np.abs(caster.depth(view.centre, rays) - depth[seen]) < OCCLUSION_TOLERANCE
    return seen


def window_truth(points: FloatArray, seen: NDArray[np.bool_], up: FloatArray, window: Window) -> dict[str, Any]:
    """Plane of the visible points (h, w, 3) of camera 1 inside a window (x, y, w, h), as truth.json lists it."""
    x, y, w, h = window
    inside = seen[y : y + h, x : x + w]
    normal, distance, rms = total_least_squares_plane(points[y : y + h, x : x + w][inside])
    return {
        "x": x,
        "y": y,
        "w": w,
        "h": h,
        "normal_cam1": normal.round(9).tolist(),
        "distance_m": round(distance, 6),
        "slope_deg": round(angle_deg(normal, up), 6),
        "rms_m": round(rms, 6),
        "visible_fraction": round(float(inside.mean()), 6),
    }


def disc_truth(points: FloatArray, up: FloatArray, window: Window) -> dict[str, Any]:
    """Plane of all points (h, w, 3) in the disc nearest to the middle of a window, as truth.json lists it."""
    x, y, w, h = window
    u, v = (DISC_FIRST + DISC_STEP * round((middle - DISC_FIRST) / DISC_STEP) for middle in (x + w / 2, y + h / 2))
    rows, columns = np.indices(points.shape[:2])
    inside = (columns - u) ** 2 + (rows - v) ** 2 <= (DISC / 2) ** 2
    normal, distance, rms = total_least_squares_plane(points[inside])
    return {
        "u": u,
        "v": v,
        "diameter_px": DISC,
        "normal_cam1": normal.round(9).tolist(),
        "distance_m": round(distance, 6),
        "slope_deg": round(angle_deg(normal, up), 6),
        "rms_m": round(rms, 6),
    }


def grid_windows(width: int, height: int, columns: int = 3, rows: int = 3) -> list[Window]:
    """The image divided evenly, row-major."""
    us = [round(i * width / columns) for i in range(columns + 1)]
    vs = [round(i * height / rows) for i in range(rows + 1)]
    return [(us[i], vs[j], us[i + 1] - us[i], vs[j + 1] - vs[j]) for j in range(rows) for i in range(columns)]


def smoothest_window(points: FloatArray, seen: NDArray[np.bool_], cell: Window) -> Window | None:
    """The square inside a cell with the least rms height among those at least 99 % visible; None without any."""
    x, y, w, h = cell
    lowest, best = np.inf, None
    for top in range(y, y + h - SMOOTH_WINDOW + 1, 8):
        for left in range(x, x + w - SMOOTH_WINDOW + 1, 8):
            area = slice(top, top + SMOOTH_WINDOW), slice(left, left + SMOOTH_WINDOW)
            if seen[area].mean() >= 0.99:
                rms = total_least_squares_plane(points[area][::4, ::4].reshape(-1, 3))[2]
                if rms < lowest:
                    lowest, best = rms, (left, top, SMOOTH_WINDOW, SMOOTH_WINDOW)
    return best


def render_descent() -> tuple[list[NDArray[np.uint8]], dict[str, Any], dict[str, Any]]:
    """Both images, the camera file and the truth."""
    first, second = descent_views()
    terrain = build_terrain()
    caster = RayCaster(terrain.height, CELL)
    radiance1, world = render_view(first, caster, terrain.radiance)
    radiance2, _ = render_view(second, caster, terrain.radiance)
    seen = visible_from(second, caster, world)
    noise = np.random.default_rng(SEED + 1)
    images = [develop(radiance1, EXPOSURE_1, noise), develop(radiance2, EXPOSURE_2, noise)]
    return images, first.camera_file(), descent_truth(first, second, first.to_camera(world), seen)


def descent_truth(first: View, second: View, points: FloatArray, seen: NDArray[np.bool_]) -> dict[str, Any]:
    """truth.json: motion, up, and the plane of every window of the 3x3 grid and of the smoothest ground."""
    up = first.rotation[:, 2]
    grid = grid_windows(first.width, first.height)
    smooth = [window for cell in grid if (window := smoothest_window(points, seen, cell)) is not None]
    return {
        **motion_truth(first, second),
        "windows": [{"id": i, **window_truth(points, seen, up, window)} for i, window in enumerate(grid, 1)],
        "smooth_windows": [{"id": i, **window_truth(points, seen, up, window)} for i, window in enumerate(smooth, 1)],
        "discs": [{"id": i, **disc_truth(points, up, window)} for i, window in enumerate(smooth, 1)],
    }
