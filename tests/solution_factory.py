"""Solutions made by hand: planes of given slopes under a level camera, with the uncertainty one asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from report_factory import make_camera, make_image, normal_of

from slopecli.geometry import homogeneous, tangent_basis
from slopecli.look import Matches
from slopecli.options import Options
from slopecli.patches import Footprint, Joined, Patch
from slopecli.patches.windows import window_patch
from slopecli.report import build_report
from slopecli.study import project
from slopecli.types import Ambiguity, Diagnostic, FloatArray, Report, Solution
from slopecli.windows import Window

CAMERA = make_camera()
HEIGHT = 5.0  # baselines from camera 1 to every plane, perpendicularly
POINTS = 30  # in every window
WINDOWS: list[Window] = [(60, 40, 160, 120), (260, 40, 120, 120), (420, 280, 140, 140)]


def scaled_normals(slopes_deg: Sequence[float], distance: float = HEIGHT, azimuth_deg: float = 60.0) -> FloatArray:
    """(m, 3), N.P = 1, of planes at one distance that fall towards one azimuth."""
    return np.array([-normal_of(slope, azimuth_deg) / distance for slope in slopes_deg])


def make_solution(
    slopes_deg: Sequence[float],
    sigma_deg: float | Sequence[float] = 0.2,
    T: Sequence[float] = (0.6, 0.0, 0.8),
    **changes: object,
) -> Solution:
    """A solution whose normals are uncertain by the same angle in all directions, and by nothing they share."""
    normals = scaled_normals(slopes_deg)
    m = len(normals)
    length = np.linalg.norm(normals, axis=1)
    sigma = np.broadcast_to(np.radians(sigma_deg) * length, (m,))
    values: dict[str, object] = {
        "R": np.eye(3),
        "T": np.array(T) / np.linalg.norm(T),
        "scaled_normals": normals,
        "normal_covariance": sigma[:, None, None] ** 2 * np.eye(3),
        "motion_covariance": np.diag([1e-8, 4e-8, 1e-8, 9e-8, 1e-8]),
        "tangent": tangent_basis(np.array(T) / np.linalg.norm(T)),
        "normal_gain": np.zeros((m, 3, 5)),
        "noise": 0.1 / CAMERA.focal_px,
        "relief": np.zeros(m),
        "rms": 0.1 / CAMERA.focal_px,
        "chi2": float(2 * POINTS * m),
        "inlier": np.ones(POINTS * m, bool),
        "converged": True,
        "iterations": 4,
        "noise_gain": 1.0,
    }
    return Solution(**{**values, **changes})  # type: ignore[arg-type]


def with_second_root(
    solution: Solution, slopes_deg: Sequence[float], status: str = "unresolved", sigma_deg: float = 0.2
) -> Solution:
    """The same solution with another one that explains the images as well (or, "resolved", worse)."""
    other = make_solution(slopes_deg, sigma_deg, T=(-0.6, 0.0, 0.8))
    found = Ambiguity(status, 2.5 if status == "unresolved" else 400.0, other)  # type: ignore[arg-type]
    return Solution(**{**vars(solution), "ambiguity": found})


def make_patch(window: Window, number: int, normal: FloatArray, solution: Solution, **changes: object) -> Patch:
    """A window with exact matches of a plane on a lattice inside it."""
    x, y, w, h = window
    columns, rows = np.meshgrid(np.linspace(x, x + w - 1, 6), np.linspace(y, y + h - 1, POINTS // 6))
    uv1 = np.column_stack([columns.ravel(), rows.ravel()])
    x1 = (uv1 - [CAMERA.cx, CAMERA.cy]) / CAMERA.focal_px
    x2 = project(solution.R, solution.T, x1, homogeneous(x1) @ normal)
    values: dict[str, object] = {
        "matches": Matches(uv1, x2 * CAMERA.focal_px + [CAMERA.cx, CAMERA.cy], x1, x2),
        "weight": np.ones(POINTS),
        "cell": np.round(uv1).astype(np.int64),
        "origin": "own",
        "score": 0.9,
        "share": 0.8,
    }
    return replace(window_patch(window, number), **{**values, **changes})  # type: ignore[arg-type]


def make_report_of(
    solution: Solution,
    options: Options | None = None,
    windows: Sequence[Window] = WINDOWS,
    refused: Sequence[int] = (),
    patch_changes: dict[int, dict[str, object]] | None = None,
    source: str = "window",
    footprints: dict[int, Footprint] | None = None,
    diagnostics: Sequence[Diagnostic] = (),
) -> Report:
    """The report of a solution whose planes lie in these windows; `refused` ones (by index) have no matches."""
    chosen = list(windows)[: len(solution.scaled_normals) + len(refused)]
    normals = iter(solution.scaled_normals)
    patches = []
    for i, window in enumerate(chosen):
        patch = window_patch(window, i + 1)
        if i in refused:
            patch = patch.unmatched("nothing to see")
        else:
            patch = make_patch(window, i + 1, next(normals), solution, **(patch_changes or {}).get(i, {}))
        patches.append(replace(patch, source=source, footprint=(footprints or {}).get(i, patch.footprint)))
    image, joined = make_image(), Joined.of(patches, Matches.none(), np.empty(0))
    return build_report((image, image), (CAMERA, CAMERA), options or Options(), joined, solution, list(diagnostics))
