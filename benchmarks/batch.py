"""Throughput, overhead and memory of `slopemap batch` on a rendered flight of small images.

    python benchmarks/batch.py [PAIRS]

Compared with a plain loop in one process over the same pairs, which loads, estimates and writes: once each pair on its
own, once with the image and the features that neighbours share kept. All are processes of their own with one thread
each. How much faster two jobs are is told by the clock, so nothing else should run; overhead by processor time.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from whole_program import Cost, cost_of

MAKE_SEQUENCE = Path(__file__).resolve().parent.parent / "sample_data" / "make_sequence.py"
PAIRS, FEW = 200, 20
MIN_SPEED_UP, MAX_OVERHEAD, MAX_GROWTH = 1.8, 0.10, 0.10

LOOP = """
import os, sys
os.environ["OPENBLAS_NUM_THREADS"] = "1"
from pathlib import Path
import cv2
cv2.setNumThreads(1)
from slopecli.io.cameras.reading import load_camera
from slopecli.io.images import load_image
from slopecli.io.outputs import write_outputs
from slopecli.options import Options
from slopecli.pipeline import estimate
from slopecli.look.features import FeatureMemory

folder, output, sharing = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3] == "sharing"
camera = load_camera(folder / "camera.json")
images = sorted(folder.glob("*.png"))
memory = FeatureMemory(2) if sharing else None
second = None
for path1, path2 in zip(images, images[1:]):
    first = second if sharing and second is not None else load_image(path1)
    second = load_image(path2)
    report = estimate(first, second, camera, camera, Options(), memory=memory)
    write_outputs(report, first, output / f"{path1.stem}-{path2.stem}")
"""


@dataclass(frozen=True)
class Row:
    """seconds: from start to end, start-up included."""

    name: str
    pairs: int
    seconds: float
    cost: Cost

    def __str__(self) -> str:
        rate, peak = self.pairs / self.seconds, self.cost.peak_mb
        return f"{self.name:28} {self.pairs:5} {self.seconds:8.1f} {rate:8.2f} {self.cost.seconds:10.1f} {peak:8.0f}"


def measure(name: str, pairs: int, command: list[str]) -> Row:
    start = time.perf_counter()
    cost = cost_of(command)
    row = Row(name, pairs, time.perf_counter() - start, cost)
    print(row, flush=True)
    return row


def batch_command(folder: Path, output: Path, jobs: int, *more: str) -> list[str]:
    command = [sys.executable, "-m", "slopecli", "batch", str(folder), "-o", str(output), "--jobs", str(jobs)]
    return [*command, "-q", *more]


def list_of_first(folder: Path, file: Path, pairs: int) -> str:
    """A list of the first pairs of a folder, for --pairing."""
    names = sorted(path.name for path in folder.glob("*.png"))[: pairs + 1]
    file.write_text("".join(f"{a},{b}\n" for a, b in pairwise(names)), encoding="utf-8")
    return str(file)


def main() -> None:
    pairs = int(sys.argv[1]) if len(sys.argv) > 1 else PAIRS
    with tempfile.TemporaryDirectory() as root:
        folder, output = Path(root, "flight"), Path(root, "out")
        subprocess.run([sys.executable, str(MAKE_SEQUENCE), str(folder), "--count", str(pairs + 1)], check=True)
        few = list_of_first(folder, Path(root, "few.csv"), FEW)
        print(f"{'':28} {'pairs':>5} {'s':>8} {'pairs/s':>8} {'processor':>10} {'peak MB':>8}")
        loops = [
            measure(f"loop, {kind}", pairs, [sys.executable, "-c", LOOP, str(folder), str(output / kind), kind])
            for kind in ("every pair alone", "sharing")
        ]
        one = measure("slopemap batch --jobs 1", pairs, batch_command(folder, output / "one", 1))
        two = measure("slopemap batch --jobs 2", pairs, batch_command(folder, output / "two", 2))
        kept = measure("the same again, all kept", pairs, batch_command(folder, output / "two", 2))
        small = measure("slopemap batch --jobs 1", FEW, batch_command(folder, output / "few", 1, "--pairing", few))
    print(f"two jobs: {one.seconds / two.seconds:.2f} times as fast as one (goal {MIN_SPEED_UP:g})")
    for loop in loops:
        overhead = one.cost.seconds / loop.cost.seconds - 1
        print(f"one job over the {loop.name}: {100 * overhead:+.1f} % (goal {MAX_OVERHEAD:.0%})")
    growth = one.cost.peak_mb / small.cost.peak_mb - 1
    print(f"peak memory, {pairs} pairs over {FEW}: {100 * growth:+.1f} % (goal {MAX_GROWTH:.0%})")
    print(f"a pair kept from before: {1000 * kept.seconds / pairs:.1f} ms")


if __name__ == "__main__":
    main()
