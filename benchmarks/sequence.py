"""Sequences frame by frame: errors, sigmas, baselines and time, beside pairs of the same frames.

    python benchmarks/sequence.py [--frames N] [--only TEXT] [--no-pairs] [--figure FILE] [--into docs/sequence.md]

Measures the rate on frames of the sample landing site (`sample_data/make_sequence.py`) that go to and fro, so that a
thousand of them stay over the same ground, and, with SLOPEMAP_DATA, errors on every rendered sequence below it that has
frames with windows of known planes: those of the part that other frames show, as windows leave the view. `estimate` on
the pair of the first frame and each other is beside it. Processor time, one thread. --figure draws sigma and error
against frames; --into writes the tables between the marks of a document.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests"))
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np
from documents import write_between
from numpy.typing import NDArray
from view_scenes import Views, views

from slopecli import sequence as sequences
from slopecli.errors import SlopemapError
from slopecli.geometry import cramer_rao_bound_of_views, normal_angle, solve_views
from slopecli.io.cameras import load_camera
from slopecli.options import Options
from slopecli.pipeline import estimate
from slopecli.types import Camera, Image, Report

ROOT = Path(__file__).resolve().parents[1]
Grey = NDArray[np.uint8]
SCENES = 40  # of the simulation in the figure


@dataclass(frozen=True, eq=False)
class TrueSequence:
    """Frames with their camera, true unit normals (m, 3) of the grid's windows, and positions (n, 3) of the frames."""

    name: str
    frames: list[Grey]
    camera: Camera
    normals: NDArray[np.float64]
    positions: NDArray[np.float64]


@dataclass(eq=False)
class Row:
    """After one frame: errors and sigmas of the windows, deg; ratio of its baseline to that of the first, over the
    truth; processor time, s; errors of `estimate` on the pair with the first frame."""

    frame: int
    errors: NDArray[np.float64]
    sigmas: NDArray[np.float64]
    ratio: float
    seconds: float
    pair: list[float] = field(default_factory=list)
    pair_seconds: float = float("nan")


def true_sequences(data: Path, only: str) -> list[TrueSequence]:
    """Every sequence below a folder that has 3x3 windows of known planes."""
    found = []
    for path in sorted(data.rglob("truth.json")):
        truth = json.loads(path.read_text(encoding="utf-8"))
        if only in str(path) and "frames" in truth and "windows_3x3" in truth["frames"][0]:
            found.append(_true_sequence(path, truth))
    return found


def _true_sequence(path: Path, truth: dict[str, Any]) -> TrueSequence:
    K = np.array(truth["K"])
    camera = Camera(truth["width"], truth["height"], K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    frames = [_grey(path.parent / frame["image"]) for frame in truth["frames"]]
    windows = truth["frames"][0]["windows_3x3"]
    normals = -np.array([window.get("n_visible_fit") or window["n"] for window in windows])
    positions = np.array([frame["T"] if frame.get("T") else [0.0, 0.0, 0.0] for frame in truth["frames"]])
    return TrueSequence(path.parent.name, frames, camera, normals, positions)


def _grey(path: Path) -> Grey:
    pixels = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    if pixels is None:
        raise SystemExit(f"{path}: cannot be read")
    return np.asarray(pixels, np.uint8)


def followed(truth: TrueSequence, pairs: bool) -> list[Row]:
    """A row for each frame that was used."""
    runner, rows = sequences.Sequence(truth.camera, Options()), []
    first = 1.0
    for number, frame in enumerate(truth.frames):
        start = time.process_time()
        state = runner.add(frame)
        spent = time.process_time() - start
        if state.status != "used" or state.T is None:
            continue
        length = float(np.linalg.norm(truth.positions[number]))
        first = first if rows else length
        errors, sigmas = _judged(runner.report(), truth)
        row = Row(number + 1, errors, sigmas, float(np.linalg.norm(state.T)) * first / length, spent)
        if pairs:
            row.pair, row.pair_seconds = _pair(truth, number)
        rows.append(row)
    return rows


def _judged(report: Report, truth: TrueSequence) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    planes = report.planes
    found = np.array([plane.normal_cam1 for plane in planes])
    true = truth.normals[[plane.id - 1 for plane in planes]]
    errors = np.degrees(np.arccos(np.clip((found * true).sum(axis=1), -1.0, 1.0)))
    return errors, np.array([plane.slope_sigma_deg or np.nan for plane in planes])


def _pair(truth: TrueSequence, number: int) -> tuple[list[float], float]:
    """Errors of `estimate` on the first frame and another, deg, and its processor time."""
    start = time.process_time()
    try:
        report = estimate(Image(truth.frames[0]), Image(truth.frames[number]), truth.camera, truth.camera, Options())
    except SlopemapError:
        return [], time.process_time() - start
    return _judged(report, truth)[0].tolist(), time.process_time() - start


def accuracy_table(truth: TrueSequence, rows: Sequence[Row]) -> str:
    """A row for each frame."""
    head = [
        "frame",
        "error, median / 90 % (deg)",
        "1 sigma (deg)",
        "within 2 sigma",
        "baseline",
        "s",
        "`estimate`",
        "s",
    ]
    lines = []
    for row in rows:
        pair = (
            "-" if not row.pair else f"{np.median(row.pair):.2f} / {np.quantile(row.pair, 0.9):.2f} ({len(row.pair)})"
        )
        lines.append(
            [
                str(row.frame),
                f"{np.median(row.errors):.2f} / {np.quantile(row.errors, 0.9):.2f}",
                f"{np.nanmedian(row.sigmas):.2f}",
                f"{(row.errors <= 2.0 * row.sigmas).sum()} of {len(row.errors)}",
                f"{row.ratio:.4f}",
                f"{row.seconds:.3f}",
                pair,
                "-" if np.isnan(row.pair_seconds) else f"{row.pair_seconds:.2f}",
            ]
        )
    return f"{truth.name}, {truth.camera.width} x {truth.camera.height}\n\n{markdown(head, lines)}"


def rate_table(count: int) -> str:
    """Time of a frame of nine windows, at two sizes, over `count` frames, and by how much memory grew."""
    lines = []
    for size in ((640, 480), (1152, 864)):
        frames, camera = _sample_frames(size)
        runner, times, before = sequences.Sequence(camera, Options()), [], 0
        order = [0, *(1 + abs((k % (2 * len(frames) - 4)) - (len(frames) - 2)) for k in range(count))]
        for number, k in enumerate(order):
            frame = frames[k].copy()
            start = time.process_time()
            runner.add(frame)
            times.append(time.process_time() - start)
            if number == min(60, count // 2):
                before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
        later = np.array(times[2:])
        used = sum(state.status == "used" for state in runner.frames)
        median, largest = float(np.median(later)), float(later.max())
        lines.append(
            [f"{size[0]} x {size[1]}", f"{used} of {len(order)}", f"{times[1]:.3f}", f"{1e3 * median:.1f}",
             f"{1.0 / median:.0f}", f"{largest / median:.1f}", f"{grown:.0f}"]
        )  # fmt: skip
    head = ["px", "frames used", "first pair (s)", "ms a frame", "frames/s", "slowest / median", "memory grew (MB)"]
    return markdown(head, lines)


def _sample_frames(size: tuple[int, int]) -> tuple[list[Grey], Camera]:
    """The first frames of a flight over the sample landing site, and their camera."""
    with tempfile.TemporaryDirectory() as folder:
        maker = str(ROOT / "sample_data" / "make_sequence.py")
        command = [sys.executable, maker, folder, "--count", "4", "--size", f"{size[0]}x{size[1]}"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        frames = [_grey(path) for path in sorted(Path(folder).glob("frame_*.png"))]
        return frames, load_camera(Path(folder, "camera.json"))


def markdown(head: list[str], rows: list[list[str]]) -> str:
    """A table of Markdown."""
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows)) + "\n"


def draw(results: Sequence[tuple[TrueSequence, list[Row]]], file: Path) -> None:
    """Median sigma and median error against frames, a curve for each sequence, those of pairs dashed."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, (simulated, axes) = plt.subplots(1, 2, figsize=(9.0, 3.6), dpi=100)
    _draw_simulation(simulated)
    for truth, rows in results:
        number = [row.frame for row in rows]
        (line,) = axes.plot(number, [np.median(row.errors) for row in rows], marker="o", label=f"{truth.name}: error")
        colour = line.get_color()
        axes.plot(number, [np.nanmedian(row.sigmas) for row in rows], color=colour, ls=":", label="its 1 sigma")
        pairs = [(row.frame, float(np.median(row.pair))) for row in rows if row.pair]
        if pairs:
            axes.plot(*zip(*pairs, strict=True), color="0.5", ls="--", marker="x", label="estimate on the pair")
    axes.set(xlabel="frame", ylabel="deg, median of the windows", ylim=(0.0, None))
    axes.legend(frameon=False)
    figure.tight_layout()
    figure.savefig(file, metadata={"Software": None})
    plt.close(figure)


def _draw_simulation(axes: Any) -> None:
    """RMS error of normals, and its Cramer-Rao bound, against frames: the paper's nine windows, steps of H / 20."""
    for trajectory, name in ((0.0, "descent"), (45.0, "glide"), (90.0, "level flight")):
        errors, least = [], []
        for number in (1, 2, 3, 5, 9):
            scenes = [views(seed, number, trajectory, path=0.05 * number) for seed in range(SCENES)]
            squares = [
                normal_angle(solve_views(one.x1, one.x, one.patch).scaled_normals, one.normals) ** 2 for one in scenes
            ]
            errors.append(np.degrees(np.sqrt(np.mean(squares))))
            least.append(np.degrees(np.sqrt(np.mean([_bound(one) for one in scenes]))))
        (line,) = axes.plot((2, 3, 4, 6, 10), errors, marker="o", label=name)
        axes.plot((2, 3, 4, 6, 10), least, color=line.get_color(), ls=":")
    axes.set(xlabel="frames, each H / 20 from the last", ylabel="RMS error of normals, deg", yscale="log")
    axes.legend(frameon=False, title="dotted: the bound")


def _bound(one: Views) -> float:
    """Mean squared error of a normal at the Cramer-Rao bound, rad^2."""
    bound = cramer_rao_bound_of_views(one.R, one.T, one.normals, one.x1, one.patch, one.noise)
    length = np.linalg.norm(one.normals, axis=1)
    n = one.normals / length[:, None]
    across = np.eye(3) - n[:, :, None] * n[:, None]
    spread = across @ bound.normal_covariance @ across / length[:, None, None] ** 2
    return float(np.trace(spread, axis1=1, axis2=2).mean())


def main() -> None:
    """Measure and print, or write into a document."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=1000, help="of the measurement of the rate")
    parser.add_argument("--only", default="", help="sequences whose path has this text")
    parser.add_argument("--no-pairs", action="store_true", help="leave estimate out")
    parser.add_argument("--figure", type=Path, help="file of the plot")
    parser.add_argument("--into", type=Path, help="document to write the tables into")
    options = parser.parse_args()
    parts = [rate_table(options.frames)] if options.frames else []
    data = os.environ.get("SLOPEMAP_DATA")
    results = []
    for truth in true_sequences(Path(data), options.only) if data else []:
        rows = followed(truth, not options.no_pairs)
        results.append((truth, rows))
        parts.append(accuracy_table(truth, rows))
    if options.figure:
        draw(results, options.figure)
    text = "\n".join(parts)
    if options.into:
        write_between(options.into, "sequences", text)
    else:
        print(text)


if __name__ == "__main__":
    main()
