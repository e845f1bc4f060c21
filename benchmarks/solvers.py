"""Accuracy and processor time of slopemap's solvers and of what others make of the same correspondences.

    python benchmarks/solvers.py [--terrains 40]

The scenes are those of `slopemap simulate`: nine patches of thirty points, noise in image 2, three trajectories; once
more with a tenth of the correspondences wrong, and over exactly flat ground, where two motions fit alike. Errors are
root mean squares over the terrains, in degrees, of the answer nearest the truth where both are told ("both" counts
these scenes); "wrong" counts scenes without an answer, or whose median normal is off by more than 5 degrees all the
same. Times are of the processor, medians; "planes" is what this script needs to fit planes under a peer's pose.
PoseLib and pycolmap are optional: pip install '.[peers]'.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from peers import Answer, Peer, find_peers

from slopecli.errors import SlopemapError
from slopecli.geometry import direction_angle, normal_angle, rotation_angle
from slopecli.study import Scene, make_scene
from slopecli.types import FloatArray

SEED, NOISE_PX = 1, 0.3
# (title, options of the scene)
SETTINGS = [
    ("vertical descent", {"trajectory_deg": 0.0}),
    ("45 deg glide", {"trajectory_deg": 45.0}),
    ("level flight", {"trajectory_deg": 90.0}),
    ("glide, 10 % mismatches", {"trajectory_deg": 45.0, "outliers": 0.1}),
    ("glide over flat ground", {"trajectory_deg": 45.0, "slopes_deg": [0.0] * 9, "height_spread": 0.0}),
]
WRONG_DEG = 5.0


@dataclass(frozen=True)
class Row:
    """One peer in one setting: RMS errors, deg; how many scenes went wrong, and where two answers were told; times, ms.

    Errors are of the answer nearest the truth where a peer tells two. wrong: scenes whose median normal is off by more
    than WRONG_DEG all the same, or that have no answer.
    """

    peer: str
    rotation: float
    direction: float
    normal: float
    wrong: int
    two: int
    time_ms: float
    planes_ms: float


def scenes(terrains: int, options: dict[str, float]) -> Iterator[Scene]:
    for terrain in range(terrains):
        yield make_scene(np.random.default_rng([SEED, terrain]), noise_px=NOISE_PX, **options)


def measured(peer: Peer, seen: list[Scene]) -> Row:
    """Errors and time of one peer; the times are medians of its answers, so that one slow start does not count."""
    errors, times, planes, two = [], [], [], 0
    for scene in seen:
        start = time.process_time()
        try:
            answer = peer.answer(scene)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError, cv2.error, SlopemapError):
            continue
        times.append(time.process_time() - start - answer.planes_s)
        planes.append(answer.planes_s)
        told = [answer] if answer.second is None else [answer, answer.second]
        two += len(told) == 2
        errors.append(min((_errors(one, scene) for one in told), key=lambda off: float(off.sum())))
    if not errors:
        return Row(peer.name, np.nan, np.nan, np.nan, len(seen), 0, np.nan, np.nan)
    off = np.degrees(np.array(errors))
    rotation, direction = np.sqrt(np.mean(off[:, :2] ** 2, axis=0))
    wrong = len(seen) - int((np.median(off[:, 2:], axis=1) <= WRONG_DEG).sum())
    normal = float(np.sqrt(np.mean(off[:, 2:] ** 2)))
    own, beside = 1e3 * float(np.median(times)), 1e3 * float(np.median(planes))
    return Row(peer.name, float(rotation), float(direction), normal, wrong, two, own, beside)


def _errors(answer: Answer, scene: Scene) -> FloatArray:
    """(2 + m,) errors of rotation, direction of motion and normals, rad."""
    direction = direction_angle(answer.T, scene.T)
    return np.array([rotation_angle(answer.R, scene.R), direction, *normal_angle(answer.normals, scene.normals)], float)


def report(terrains: int = 40) -> str:
    """The tables, as text."""
    peers, absent = find_peers()
    head = f"{'rotation':>9} {'direction':>10} {'normals':>8} {'wrong':>6} {'both':>5} {'time':>10} {'planes':>10}"
    lines = []
    for title, options in SETTINGS:
        seen = list(scenes(terrains, options))
        lines.append(f"{title:32} {head}")
        for row in (measured(peer, seen) for peer in peers):
            planes = f"{row.planes_ms:7.2f} ms" if row.planes_ms else ""
            lines.append(
                f"  {row.peer:30} {row.rotation:9.3f} {row.direction:10.3f} {row.normal:8.3f}"
                f" {row.wrong:6d} {row.two:5d} {row.time_ms:7.2f} ms {planes}".rstrip()
            )
    return "\n".join([*lines, *absent])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--terrains", type=int, default=40)
    print(report(parser.parse_args().terrains))


if __name__ == "__main__":
    main()
