"""Processor time of the joint solver against fitting and decomposing every patch's homography by itself with OpenCV.

Both see the same correspondences in the same run, and each time is the least of many, taken in turns so that a busy
machine slows both alike. The solver's share includes the starts, every root, the covariance and the outlier check.

Run with one BLAS thread: OPENBLAS_NUM_THREADS=1 python benchmarks/solver_speed.py
"""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np

from slopecli.geometry import solve_planes
from slopecli.simulate import Scene, make_scene

# (title, grid, options, rounds, largest ratio allowed)
CASES = [
    ("9 patches", (3, 3), {}, 300, 3.0),
    ("9 patches, coplanar", (3, 3), {"slopes_deg": [0.0] * 9, "height_spread": 0.0}, 300, None),
    ("100 patches", (10, 10), {}, 50, None),
    ("1024 patches", (32, 32), {}, 8, 1.0),
]


def separately(scene: Scene) -> Callable[[], None]:
    """Direct linear transform and decomposition of each patch; its points are picked out beforehand."""
    parts = [(scene.x1[scene.patch == i], scene.x2[scene.patch == i]) for i in range(len(scene.normals))]

    def run() -> None:
        for x1, x2 in parts:
            H, _ = cv2.findHomography(x1, x2, 0)
            cv2.decomposeHomographyMat(H, np.eye(3))

    return run


def least_times(a: Callable[[], object], b: Callable[[], object], rounds: int) -> tuple[float, float]:
    """Least processor time of two functions run in turns, seconds."""
    best = [np.inf, np.inf]
    for _ in range(rounds):
        for i, function in enumerate((a, b)):
            start = time.process_time()
            function()
            best[i] = min(best[i], time.process_time() - start)
    return best[0], best[1]


def main() -> None:
    cv2.setNumThreads(1)
    print(f"{'scene':22} {'solve_planes':>12} {'OpenCV':>10} {'ratio':>7} {'roots':>6}")
    for title, grid, options, rounds, limit in CASES:
        scene = make_scene(np.random.default_rng(1), grid=grid, **options)
        solution = solve_planes(scene.x1, scene.x2, scene.patch)
        ours, theirs = least_times(lambda s=scene: solve_planes(s.x1, s.x2, s.patch), separately(scene), rounds)
        roots = 1 + (solution.ambiguity.alternative is not None)
        goal = f"  (goal {limit:g})" if limit else ""
        print(f"{title:22} {ours * 1e3:9.2f} ms {theirs * 1e3:7.2f} ms {ours / theirs:7.2f} {roots:6d}{goal}")


if __name__ == "__main__":
    main()
