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
CAMERA = Camera(1024, 768, 800.0, 800.0, 511.5, 383.5)


def sample_scene() -> Scene:
    """Nine planes of slopes up to 40 degrees, and the truth of them."""
    rng = np.random.default_rng(SEED)
    return make_scene(rng, trajectory_deg=60.0, noise_px=NOISE_PX, camera=CAMERA)


def main() -> None:
    scene = sample_scene()
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(["x1", "y1", "x2", "y2", "patch"])
    for one, two, patch in zip(scene.uv1, scene.uv2, scene.patch, strict=True):
        writer.writerow([f"{value:.3f}" for value in (*one, *two)] + [patch + 1 if patch >= 0 else -1])


if __name__ == "__main__":
    main()
