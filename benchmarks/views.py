"""The solver of many views alone, in simulation: its errors against the bound, and what a third view decides.

    python benchmarks/views.py [--scenes N] [--planes N] [--into docs/sequence.md]

Scenes are those of the paper's section 4.1: nine windows of 30 points. For every number of views, trajectory and noise,
--scenes of them give the RMS error of normals over the Cramer-Rao bound of all views, and the share of errors within
their 95 % ellipses. Two roots: --planes scenes of one plane, for each trajectory, whose third view is turned off the
line of the first move. --into writes the tables between the marks of a document.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from itertools import product
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))

import numpy as np
from documents import write_between
from numpy.typing import NDArray
from view_scenes import Views, views

from slopecli.geometry import ViewsSolution, cramer_rao_bound_of_views, normal_angle, solve_views

TRAJECTORIES = {"descent": 0.0, "glide": 45.0, "level flight": 90.0}  # first step, deg from the vertical
TURN_DEG = 25.0  # of the third view of a plane off the line of the first move
ELLIPSE_95 = 5.991  # chi-square of two degrees of freedom
RIGHT = 30.0  # chi-square beyond which a normal is that of the other root: by chance once in 3 million


def tilts(solution: ViewsSolution) -> NDArray[np.float64]:
    """(m, 3, 3) covariance of the unit normals."""
    length = np.linalg.norm(solution.scaled_normals, axis=1)
    n = solution.scaled_normals / length[:, None]
    across = np.eye(3) - n[:, :, None] * n[:, None]
    return np.asarray(across @ solution.normal_covariance @ across / length[:, None, None] ** 2)


def chi2_of(found: ViewsSolution, scene: Views) -> NDArray[np.float64]:
    """(m,) squared error of each normal over its covariance."""
    one, true = (N / np.linalg.norm(N, axis=1, keepdims=True) for N in (found.scaled_normals, scene.normals))
    inverse = np.linalg.pinv(tilts(found), rcond=1e-9, hermitian=True)
    return np.einsum("ma,mab,mb->m", one - true, inverse, one - true)


def errors_table(scenes: int) -> str:
    """RMS error over the bound, and the share of errors within their ellipses, a row a number of frames and noise."""
    rows = []
    for frames, noise in product((3, 5, 10), (0.1, 0.3, 1.0)):
        cells = []
        for trajectory in TRAJECTORIES.values():
            squared, least, chi2 = [], [], []
            for seed in range(scenes):
                scene = views(seed, frames - 1, trajectory, noise_px=noise)
                found = solve_views(scene.x1, scene.x, scene.patch)
                bound = cramer_rao_bound_of_views(scene.R, scene.T, scene.normals, scene.x1, scene.patch, scene.noise)
                squared.append(normal_angle(found.scaled_normals, scene.normals) ** 2)
                least.append(np.trace(tilts(bound), axis1=1, axis2=2))
                chi2.append(chi2_of(found, scene))
            covered = float(np.mean(np.array(chi2) < ELLIPSE_95))
            cells.append(f"{np.sqrt(np.mean(squared) / np.mean(least)):.2f}, {100 * covered:.1f} %")
        rows.append([str(frames), f"{noise:g}", *cells])
    return markdown(["frames", "noise (px)", *TRAJECTORIES], rows)


def planes_table(scenes: int) -> str:
    """Scenes of one plane that a third view decides: how many, wrongly, and those open where neither answer is true."""
    rows = []
    for name, trajectory in TRAJECTORIES.items():
        decided = wrong = lost = 0
        for seed in range(scenes):
            scene = views(seed, 2, trajectory, path=0.4, bend_deg=TURN_DEG, one_plane=True, steepest_deg=20.0)
            found = solve_views(scene.x1, scene.x, scene.patch)
            right = [one is not None and chi2_of(one, scene).max() < RIGHT for one in (found, found.alternative)]
            decided += found.status != "unresolved"
            wrong += found.status != "unresolved" and not right[0]
            lost += found.status == "unresolved" and not any(right)
        rows.append([name, str(scenes), str(decided), str(wrong), str(lost)])
    return markdown(["first move", "planes", "decided", "wrongly", "open, and neither is true"], rows)


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of Markdown."""
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows)) + "\n"


def main() -> None:
    """Measure and print, or write into a document."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=200, help="of each number of frames, trajectory and noise")
    parser.add_argument("--planes", type=int, default=1334, help="of each trajectory, with two roots")
    parser.add_argument("--into", type=Path, help="document to write the tables into")
    options = parser.parse_args()
    wanted = ((errors_table, options.scenes), (planes_table, options.planes))
    text = "\n".join(table(number) for table, number in wanted if number)
    if options.into:
        write_between(options.into, "views", text)
    else:
        print(text)


if __name__ == "__main__":
    main()
