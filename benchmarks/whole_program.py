"""Processor time and peak memory of a whole `slopemap estimate` against plain OpenCV scripts on the same pair.

One script reads both images, finds SIFT features in both, matches them and fits one essential matrix: less than any
answer takes. It runs in two variants, exhaustive matching and FLANN. Another is the floor that nothing can go below:
start-up and imports, both images decoded, corners in one of them, each tracked once into the other. All are processes
of their own, slopemap and the floors started in turns, so that a busy machine slows them alike, the scripts after them
and less often, as they take longer; of each the least of its runs counts, start-up of Python included.

    python benchmarks/whole_program.py [IMAGE1 IMAGE2 CAMERA.json | --megapixel]

With --megapixel the pair is rendered first, 1024 x 1024 px, as `sample_data/make_sequence.py` does (it needs SciPy).
"""

from __future__ import annotations

import compileall
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SAMPLE = ROOT / "sample_data" / "descent"
ROUNDS, ROUNDS_OF_SCRIPTS = 9, 3
MAX_RATIO, MAX_FLOORS, MAX_PEAK_MB = 1.0, 2.0, 400.0

PLAIN = """
import sys
import time

import cv2
import numpy as np

marks = [0.0, time.process_time()]
image1, image2 = (cv2.imread(path, cv2.IMREAD_GRAYSCALE) for path in sys.argv[1:3])
marks.append(time.process_time())
K = np.array([[float(sys.argv[3]), 0, float(sys.argv[5])], [0, float(sys.argv[4]), float(sys.argv[6])], [0, 0, 1]])
sift = cv2.SIFT_create()
keypoints1, descriptors1 = sift.detectAndCompute(image1, None)
keypoints2, descriptors2 = sift.detectAndCompute(image2, None)
marks.append(time.process_time())
trees = cv2.FlannBasedMatcher({"algorithm": 1, "trees": 5}, {"checks": 50})
matcher = trees if sys.argv[7] == "flann" else cv2.BFMatcher()
pairs = matcher.knnMatch(descriptors1, descriptors2, k=2)
good = [best for best, second in pairs if best.distance < 0.75 * second.distance]
marks.append(time.process_time())
points1 = np.float64([keypoints1[match.queryIdx].pt for match in good])
points2 = np.float64([keypoints2[match.trainIdx].pt for match in good])
E, inlier = cv2.findEssentialMat(points1, points2, K, cv2.RANSAC, 0.999, 1.0)
marks.append(time.process_time())
for name, seconds in zip(("start+imports", "decode", "features", "matching", "motion"), np.diff(marks)):
    print(f"{name:<14s} {seconds:6.3f} s")
"""

FLOOR = """
import sys
import time

import cv2
import numpy as np

marks = [0.0, time.process_time()]
image1, image2 = (cv2.imread(path, cv2.IMREAD_GRAYSCALE) for path in sys.argv[1:3])
marks.append(time.process_time())
corners = cv2.goodFeaturesToTrack(image1, 4000, 0.01, 7)
marks.append(time.process_time())
tracked, found, _ = cv2.calcOpticalFlowPyrLK(image1, image2, corners, None)
marks.append(time.process_time())
for name, seconds in zip(("start+imports", "decode", "corners", "tracking"), np.diff(marks)):
    print(f"{name:<14s} {seconds:6.3f} s")
"""


# as a user's shell starts them: how many threads it starts is a program's own affair
ENVIRONMENT = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}


@dataclass(frozen=True)
class Cost:
    """Processor time of all threads, s; largest resident memory, MB; what was said."""

    seconds: float
    peak_mb: float
    stdout: str
    stderr: str


def cost_of(command: list[str]) -> Cost:
    """Run one process and ask the system what it took; stop where it fails."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        process = subprocess.Popen(command, stdout=out, stderr=err, env=ENVIRONMENT)
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        stdout, stderr = (stream.seek(0) or stream.read() for stream in (out, err))
    if process.returncode:
        sys.exit(f"{' '.join(command)} ended with status {process.returncode}: {stderr.strip()}")
    unit = 1024**2 if sys.platform == "darwin" else 1024  # bytes there, kilobytes elsewhere
    return Cost(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / unit, stdout, stderr)


def estimate_command(image1: Path, image2: Path, camera: Path, folder: str, *more: str) -> list[str]:
    """`slopemap estimate -v` with all its outputs, by the interpreter that runs this script."""
    pair = [str(image1), str(image2), "--camera", str(camera)]
    return [sys.executable, "-m", "slopecli", "estimate", *pair, "-o", folder, "-v", *more]


def plain_command(image1: Path, image2: Path, camera: Path, matcher: str) -> list[str]:
    numbers = json.loads(camera.read_text(encoding="utf-8"))
    if "K" in numbers:
        K = numbers["K"]
        focal_and_centre = [K[0][0], K[1][1], K[0][2], K[1][2]]
    else:
        focal_and_centre = [numbers[name] for name in ("fx", "fy", "cx", "cy")]
    return [sys.executable, "-c", PLAIN, str(image1), str(image2), *map(str, focal_and_centre), matcher]


def floor_command(image1: Path, image2: Path, *, one_thread: bool = False) -> list[str]:
    """one_thread : of NumPy's linear algebra; a second one waits for work that never comes, and its waiting counts."""
    before = ["env", "OPENBLAS_NUM_THREADS=1"] if one_thread else []
    return [*before, sys.executable, "-c", FLOOR, str(image1), str(image2)]


def megapixel_pair(folder: Path) -> list[Path]:
    """Two images of a descent, 1024 x 1024 px, and their camera, rendered into a folder."""
    make = [sys.executable, str(SAMPLE.parent / "make_sequence.py"), str(folder), "--count", "2", "--size", "1024x1024"]
    subprocess.run(make, check=True)
    return [*sorted(folder.glob("*.png"))[:2], folder / "camera.json"]


def least_of(commands: dict[str, list[str]], rounds: int) -> dict[str, Cost]:
    """The cheapest run of each command, run in turns."""
    runs: dict[str, list[Cost]] = {name: [] for name in commands}
    for _ in range(rounds):
        for name, command in commands.items():
            runs[name].append(cost_of(command))
    return {name: min(costs, key=lambda cost: cost.seconds) for name, costs in runs.items()}


def measured(files: Sequence[Path], folder: str) -> str:
    """The table of costs and the stages of each process, as text."""
    image1, image2, camera = files
    # as the packages that the others import were when they were installed, whatever this shell forbids
    compileall.compile_dir(ROOT / "slopecli", quiet=1)
    scripts = {f"OpenCV, {name}": plain_command(image1, image2, camera, name) for name in ("brute", "flann")}
    commands = {
        "slopemap estimate": estimate_command(image1, image2, camera, folder),
        "floor": floor_command(image1, image2),
        "floor, one thread": floor_command(image1, image2, one_thread=True),
    }
    costs = least_of(commands, ROUNDS) | least_of(scripts, ROUNDS_OF_SCRIPTS)
    ours = costs["slopemap estimate"]
    lines = [f"{'':18} {'processor':>10} {'peak memory':>12} {'slopemap takes':>15}"]
    for name, cost in costs.items():
        ratio = "" if cost is ours else f" {ours.seconds / cost.seconds:14.2f}x"
        lines.append(f"{name:18} {cost.seconds:8.2f} s {cost.peak_mb:9.0f} MB{ratio}")
    lines.append(
        f"goals: at most {MAX_RATIO:g}x of either OpenCV script and at most {MAX_FLOORS:g}x either floor, "
        f"peak below {MAX_PEAK_MB:g} MB"
    )
    for title, text in (
        ("slopemap estimate -v (what is left of the whole is start-up)", ours.stderr),
        ("the OpenCV script, flann", costs["OpenCV, flann"].stdout),
        ("the floor, one thread", costs["floor, one thread"].stdout),
    ):
        lines += ["", f"stages of {title}", *(f"  {line}" for line in text.splitlines() if line.endswith(" s"))]
    return "\n".join(lines)


def report() -> str:
    """The tables for a pair of a megapixel, as text."""
    with tempfile.TemporaryDirectory() as folder:
        return measured(megapixel_pair(Path(folder, "pair")), folder)


def main() -> None:
    arguments = sys.argv[1:]
    if arguments == ["--megapixel"]:
        print(report())
    elif len(arguments) in (0, 3):
        files = [Path(name) for name in arguments or (SAMPLE / n for n in ("image1.png", "image2.png", "camera.json"))]
        with tempfile.TemporaryDirectory() as folder:
            print(measured(files, folder))
    else:
        sys.exit(f"usage: {sys.argv[0]} [IMAGE1 IMAGE2 CAMERA.json | --megapixel]")


if __name__ == "__main__":
    main()
