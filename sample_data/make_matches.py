"""Make matches.csv: correspondences of nine planes seen in a slanting descent, for `slopemap solve`.

    python sample_data/make_matches.py > sample_data/matches.csv

The camera is fx = fy = 800 px, cx, cy = 511.5, 383.5 without distortion; matches have noise of 0.3 px.
"""

from __future__ import annotations

import csv
import sys

import numpy as np

from slopecli.study import Scene, make_scene
from slopecli.types import Camera

SEED = 7
NOISE_PX = 0.3
POINTS = 30  # of each plane
CAMERA = Camera(1024, 768, 800.0, 800.0, 511.5, 383.5)


def sample_scene() -> Scene:
    """Nine planes of slopes up to 40 degrees, more points on each than are wanted, and the truth of them."""
    rng = np.random.default_rng(SEED)
    return make_scene(rng, trajectory_deg=60.0, noise_px=NOISE_PX, camera=CAMERA, points=8 * POINTS)


def chosen(scene: Scene) -> np.ndarray:
    """Rows of the first points of every plane that lie in image 2 as well."""
    inside = ((scene.uv2 >= 0.0) & (scene.uv2 <= [CAMERA.width - 1, CAMERA.height - 1])).all(axis=1)
    return np.concatenate([np.flatnonzero(inside & (scene.patch == one))[:POINTS] for one in range(9)])


def main() -> None:
    scene = sample_scene()
    rows = chosen(scene)
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(["x1", "y1", "x2", "y2", "patch"])
    for one, two, patch in zip(scene.uv1[rows], scene.uv2[rows], scene.patch[rows], strict=True):
        writer.writerow([f"{value:.3f}" for value in (*one, *two)] + [patch + 1])


if __name__ == "__main__":
    main()
