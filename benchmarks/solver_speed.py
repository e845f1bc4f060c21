"""Processor time of the joint solver: against OpenCV patch by patch, and as patches and points grow in number.

Both see the same correspondences in the same run, and each time is the least of many, taken in turns so that a busy
machine slows both alike. The solver's share includes the starts, every root, the covariance and the outlier check.

    OPENBLAS_NUM_THREADS=1 python benchmarks/solver_speed.py

runs it with one BLAS thread, as the program does. The exponent is that of the power law fitted to all times of a row.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import cv2
import numpy as np

from slopecli.geometry import solve_planes
from slopecli.study import Scene, make_scene

# (title, grid, options, rounds, largest ratio allowed)
CASES = [
    ("9 patches", (3, 3), {}, 300, 3.0),
    ("9 patches, coplanar", (3, 3), {"slopes_deg": [0.0] * 9, "height_spread": 0.0}, 300, None),
    ("100 patches", (10, 10), {}, 50, None),
    ("1024 patches", (32, 32), {}, 8, 0.5),
]
SIDES = (8, 16, 32, 64)  # 64 to 4096 patches of 30 points
POINTS = (30, 100, 300, 1000, 3000)  # in each of nine patches
MAX_EXPONENT = 1.05
REPEATS = 5


def separately(scene: Scene) -> Callable[[], None]:
    """Direct linear transform and decomposition of each patch; its points are picked out beforehand."""
    parts = [(scene.x1[scene.patch == i], scene.x2[scene.patch == i]) for i in range(len(scene.normals))]

    def run() -> None:
        for x1, x2 in parts:
            H, _ = cv2.findHomography(x1, x2, 0)
            cv2.decomposeHomographyMat(H, np.eye(3))

    return run


def least_times(functions: Sequence[Callable[[], object]], rounds: int) -> list[float]:
    """Least processor time of each function, all run in turns, seconds."""
    best = [float("inf")] * len(functions)
    for _ in range(rounds):
        for i, function in enumerate(functions):
            start = time.process_time()
            function()
            best[i] = min(best[i], time.process_time() - start)
    return best


def against_opencv() -> list[str]:
    lines = [f"{'scene':22} {'solve_planes':>12} {'OpenCV':>10} {'ratio':>7} {'roots':>6}"]
    for title, grid, options, rounds, limit in CASES:
        scene = make_scene(np.random.default_rng(1), grid=grid, **options)
        solution = solve_planes(scene.x1, scene.x2, scene.patch)
        ours, theirs = least_times([lambda s=scene: solve_planes(s.x1, s.x2, s.patch), separately(scene)], rounds)
        roots = 1 + (solution.ambiguity.alternative is not None)
        goal = f"  (goal {limit:g})" if limit else ""
        lines.append(f"{title:22} {ours * 1e3:9.2f} ms {theirs * 1e3:7.2f} ms {ours / theirs:7.2f} {roots:6d}{goal}")
    return lines


def growth() -> list[str]:
    """Times as patches and as points per patch grow in number, and the exponents."""
    rng = np.random.default_rng(1)
    many_patches = [make_scene(rng, grid=(side, side)) for side in SIDES]
    many_points = [make_scene(rng, points=points) for points in POINTS]
    return [
        *_growth_line("patches of 30 points", [side**2 for side in SIDES], many_patches),
        *_growth_line("points in each of 9", list(POINTS), many_points),
        f"goal of either exponent: at most {MAX_EXPONENT:g}",
    ]


def _growth_line(title: str, sizes: list[int], scenes: list[Scene]) -> list[str]:
    runs: list[Callable[[], object]] = [lambda s=scene: solve_planes(s.x1, s.x2, s.patch) for scene in scenes]
    seconds = least_times(runs, REPEATS)
    exponent = np.polyfit(np.log(sizes), np.log(seconds), 1)[0]
    times = "".join(f"{1e3 * s:9.2f} ms" for s in seconds)
    return [f"{title:22}" + "".join(f"{size:12d}" for size in sizes), f"{'':22}{times}  exponent {exponent:.2f}"]


def report() -> str:
    """The tables, as text."""
    cv2.setNumThreads(1)
    return "\n".join([*against_opencv(), "", *growth()])


if __name__ == "__main__":
    print(report())
