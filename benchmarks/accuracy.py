"""Angles between estimated and true normals on pairs with known truth, by the installed program.

    python benchmarks/accuracy.py [--only TEXT] [--pairs] [--into docs/accuracy.md]

The pairs lie below SLOPEMAP_DATA: `*.truth.json` beside photographs, `truth.json` in the folder of a rendered pair.
Each gets the windows its truth lists, or else the largest square inside every true plane, as `--window` options. A
window without an answer counts as wrong. Overconfident is an error beyond 1 degree and 4 of the window's own sigmas
with no second motion declared. Pairs that are hostile on purpose get the default grid; what counts is what they are
answered. --only takes pairs whose path holds TEXT, --pairs adds a line for every pair, and --into writes the tables
between the marks of a document.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from documents import write_between
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]
Window = tuple[int, int, int, int]

MIN_VISIBLE = 0.9  # of a listed window, in image 2
MIN_HALF_SIDE_PX, BORDER_PX = 20, 2  # of a square inside a true plane, and its distance from the plane's outline


@dataclass(frozen=True, eq=False)
class TruePair:
    """A pair and its truth: cameras as native camera files, normals (3,) out of the surface; motion where known.

    normal_sigmas_deg : 1-sigma of the true normals as stated with them; 0 where the truth is exact.
    """

    path: Path
    image1: Path
    image2: Path
    cameras: tuple[dict[str, Any], dict[str, Any]]
    windows: list[Window]
    normals: list[FloatArray]
    normal_sigmas_deg: list[float]
    R: FloatArray | None
    T: FloatArray | None
    expected: str  # what the answer of a hostile pair should be: "refuse" or "warn", and why; else ""

    @property
    def name(self) -> str:
        return self.path.parent.name if self.path.name == "truth.json" else self.path.name.removesuffix(".truth.json")

    @property
    def set_name(self) -> str:
        """Rendered pairs come in sets named by a letter, photographs in a folder each."""
        return f"rendered {self.name[0]}" if self.path.name == "truth.json" else f"real {self.path.parent.name}"


@dataclass(frozen=True, eq=False)
class Judged:
    """How one pair went. errors_deg, sigmas_deg: per window, NaN without an answer; rotation_deg, direction_deg:
    errors of the motion, NaN where the true one is unknown."""

    pair: TruePair
    exit_code: int
    message: str
    errors_deg: FloatArray
    sigmas_deg: FloatArray
    rotation_deg: float
    direction_deg: float
    ambiguity: str
    diagnostics: tuple[str, ...]

    @property
    def overconfident(self) -> int:
        """Windows that are wrong by more than they admit."""
        if self.ambiguity == "unresolved":
            return 0
        return int((self.errors_deg > 1 + 4 * np.nan_to_num(self.sigmas_deg)).sum())


# ---- the truth ----


def true_pairs(data: Path, only: str = "") -> Iterator[TruePair]:
    """All pairs with intrinsics below a folder; sequences of more than two images are left out."""
    for path in [*sorted(data.glob("**/truth.json")), *sorted(data.glob("**/*.truth.json"))]:
        truth = json.loads(path.read_text(encoding="utf-8"))
        intrinsics = truth.get("K") or truth.get("K1")
        if only in str(path.relative_to(data)) and "frames" not in truth and intrinsics is not None:
            yield _true_pair(path, truth)


def _true_pair(path: Path, truth: dict[str, Any]) -> TruePair:
    images = path.parent / truth["image1"], path.parent / truth["image2"]
    sizes = [_read(image, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION).shape for image in images]
    cameras = _camera(truth, "1", sizes[0]), _camera(truth, "2", sizes[1])
    found = list(_true_windows(path.parent, truth, sizes[0]))
    expected = truth.get("expected", {})
    hostile = "" if expected.get("verdict", "ok") == "ok" else f"{expected['verdict']}: {expected['code']}"
    windows, sigmas = [window for window, *_ in found], [sigma for *_, sigma in found]
    normals = [_outward(np.array(n), w, cameras[0]) for w, n, _ in found]
    return TruePair(path, *images, cameras, windows, normals, sigmas, *_true_motion(truth), hostile)


def _read(path: Path, flags: int) -> NDArray[Any]:
    pixels = cv2.imread(str(path), flags)
    if pixels is None:
        sys.exit(f"{path}: cannot be read as an image")
    return pixels


def _camera(truth: dict[str, Any], which: str, shape: tuple[int, ...]) -> dict[str, Any]:
    K = truth["K"] if "K" in truth else truth[f"K{which}"]
    distortion = truth.get("dist") or truth.get(f"dist{which}") or []
    return {"width": shape[1], "height": shape[0], "K": K, "distortion": distortion}


def _true_motion(truth: dict[str, Any]) -> tuple[FloatArray | None, FloatArray | None]:
    """R and T of P2 = R (P1 - T); photographs state t of P2 = R P1 + t."""
    R = None if truth.get("R") is None else np.array(truth["R"])
    T = None
    if "T" in truth:
        T = np.array(truth["T"])
    elif R is not None and truth.get("t") is not None:
        T = -R.T @ np.array(truth["t"])
    return R, T


def _true_windows(
    folder: Path, truth: dict[str, Any], shape: tuple[int, ...]
) -> Iterator[tuple[Window, list[float], float]]:
    """Windows on true planes, the normals of these and the 1-sigma of each in degrees."""
    listed = truth.get("windows_151")
    if listed:
        for w in listed:
            if w["visible_fraction"] > MIN_VISIBLE:
                yield (w["x0"], w["y0"], w["x1"] - w["x0"], w["y1"] - w["y0"]), w.get("n_visible_fit", w["n"]), 0.0
        return
    visible = np.ones(shape, bool)
    if truth.get("visible"):
        visible = _read(folder / truth["visible"], cv2.IMREAD_GRAYSCALE) > 0
    for plane in truth.get("planes") or []:
        if plane.get("n") is not None and plane.get("trusted", True):
            window = largest_square(_footprint(folder, truth, plane, shape) & visible)
            if window is not None:
                yield window, plane["n"], float(plane.get("normal_sigma_deg") or 0.0)


def _footprint(folder: Path, truth: dict[str, Any], plane: dict[str, Any], shape: tuple[int, ...]) -> Mask:
    """Pixels (h, w) of image 1 on a true plane."""
    if "polygon" in plane:
        painted = np.zeros(shape, np.uint8)
        cv2.fillPoly(painted, [np.round(plane["polygon"]).astype(np.int32)], 1)
        return painted > 0
    labels = _read(folder / (plane.get("mask") or truth["labels"]), cv2.IMREAD_UNCHANGED)
    return np.asarray(labels == plane.get("label", plane.get("id")))


def largest_square(mask: Mask) -> Window | None:
    """The largest upright square inside a mask (h, w), a little off its outline; None where none is large enough."""
    distance = cv2.distanceTransform(np.pad(mask.astype(np.uint8), 1), cv2.DIST_C, 3)[1:-1, 1:-1]
    y, x = (int(i) for i in np.unravel_index(distance.argmax(), distance.shape))
    half = int(distance[y, x]) - BORDER_PX
    return (x - half, y - half, 2 * half, 2 * half) if half >= MIN_HALF_SIDE_PX else None


def _outward(normal: FloatArray, window: Window, camera: dict[str, Any]) -> FloatArray:
    """The normal, turned towards camera 1 as seen at the middle of the window."""
    x, y, w, h = window
    ray = np.linalg.inv(np.array(camera["K"])) @ [x + w / 2, y + h / 2, 1]
    return -normal if normal @ ray > 0 else normal


# ---- the answer ----


def run_program(pair: TruePair) -> Judged:
    """One `slopemap estimate`, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "slopecli", "estimate", str(pair.image1), str(pair.image2), "-o", folder]
        for option, camera in zip(("camera", "camera2"), pair.cameras, strict=True):
            file = Path(folder) / f"{option}.json"
            file.write_text(json.dumps(camera), encoding="utf-8")
            command += [f"--{option}", str(file)]
        for window in pair.windows:
            command += ["--window", ",".join(map(str, window))]
        done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
        if done.returncode:
            return unanswered(pair, done.returncode, (done.stderr.strip().splitlines() or [""])[-1])
        return judged(pair, json.loads((Path(folder) / "slopes.json").read_text(encoding="utf-8")))


def unanswered(pair: TruePair, exit_code: int, message: str) -> Judged:
    nothing = np.full(len(pair.windows), np.nan)
    return Judged(pair, exit_code, message, nothing, nothing, math.nan, math.nan, "", ())


def judged(pair: TruePair, answer: dict[str, Any]) -> Judged:
    """Compare the content of slopes.json with the truth."""
    planes = {plane["id"]: plane for plane in answer["planes"]}
    errors, sigmas = np.full((2, len(pair.windows)), np.nan)
    for i, normal in enumerate(pair.normals):
        if i + 1 in planes:
            errors[i] = angle_deg(np.array(planes[i + 1]["normal_cam1"]), normal)
            sigmas[i] = planes[i + 1]["slope_sigma_deg"]
    rotation = direction = math.nan
    if pair.R is not None and pair.T is not None and pair.T.any():
        rotation = _rotation_deg(np.array(answer["motion"]["rotation_cam2_from_cam1"]) @ pair.R.T)
        direction = angle_deg(np.array(answer["motion"]["baseline_cam1"]), pair.T)
    codes = tuple(diagnostic["code"] for diagnostic in answer["diagnostics"])
    return Judged(pair, 0, "", errors, sigmas, rotation, direction, answer["ambiguity"]["status"], codes)


def angle_deg(a: FloatArray, b: FloatArray) -> float:
    """Angle between two vectors, well-conditioned at 0 and 180 degrees."""
    return math.degrees(math.atan2(float(np.linalg.norm(np.cross(a, b))), float(a @ b)))


def _rotation_deg(R: FloatArray) -> float:
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return math.degrees(math.atan2(float(np.linalg.norm(axis)), float(np.trace(R)) - 1))


# ---- the tables ----

HEAD = ["pairs", "windows", "answered", "median", "90 %", "max", "≤ 1°", "≤ 2°", "≤ 5°"]
HEAD += ["overconfident", "rotation", "direction"]


def summary(results: list[Judged]) -> list[str]:
    """Cells of one row, angles in degrees; shares are of all windows, rotation and direction the worst of the pairs."""
    errors = np.concatenate([result.errors_deg for result in results])
    found = errors[np.isfinite(errors)]
    cells = [str(len(results)), str(len(errors)), _percent(len(found), len(errors))]
    for statistic in (np.median, lambda e: np.quantile(e, 0.9), np.max):
        cells.append(f"{statistic(found):.2f}" if len(found) else "-")
    cells += [_percent(int((found <= limit).sum()), len(errors)) for limit in (1, 2, 5)]
    cells.append(str(sum(result.overconfident for result in results)))
    return cells + [_worst([getattr(r, name) for r in results]) for name in ("rotation_deg", "direction_deg")]


def _percent(count: int, total: int) -> str:
    return f"{100 * count / total:.0f} %" if total else "-"


def _worst(values: list[float]) -> str:
    known = [value for value in values if math.isfinite(value)]
    return f"{max(known):.3f}" if known else "-"


def grouped(results: list[Judged], key: Callable[[Judged], str]) -> dict[str, list[Judged]]:
    groups: dict[str, list[Judged]] = {}
    for result in results:
        groups.setdefault(key(result), []).append(result)
    return groups


def markdown(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def accuracy_tables(results: list[Judged], every_pair: bool) -> str:
    """The sets, with their totals; the hostile pairs, by what they were answered; on request every pair."""
    usual = [r for r in results if not r.pair.expected and r.pair.windows]
    rows = []
    for kind, of_kind in grouped(usual, lambda r: r.pair.set_name.split()[0]).items():
        rows += [[name, *summary(group)] for name, group in grouped(of_kind, lambda r: r.pair.set_name).items()]
        rows.append([f"**{kind}, all**", *summary(of_kind)])
    parts = [markdown(["set", *HEAD], rows)] if rows else []
    hostile = [[r.pair.name, r.pair.expected, _outcome(r)] for r in results if r.pair.expected]
    if hostile:
        parts.append(markdown(["pair", "should", "does"], hostile))
    if every_pair and usual:
        pairs = [[r.pair.name, *summary([r])[1:], _outcome(r)] for r in usual]
        parts.append(markdown(["pair", *HEAD[1:], "outcome"], pairs))
    return "\n\n".join(parts)


def _outcome(result: Judged) -> str:
    if result.exit_code:
        return f"exit status {result.exit_code}: {result.message.removeprefix('slopemap: error: ')}"
    said = ", ".join(dict.fromkeys(result.diagnostics)) or "no diagnostic"
    return said if result.ambiguity == "none" else f"{said}; second motion {result.ambiguity}"


def data_folder() -> Path | None:
    """The folder that SLOPEMAP_DATA names; without it one line is printed, and None returned."""
    data = os.environ.get("SLOPEMAP_DATA")
    if not data:
        print("SLOPEMAP_DATA is not set: there are no pairs with truth to run")
    return Path(data) if data else None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", default="", metavar="TEXT")
    parser.add_argument("--pairs", action="store_true")
    parser.add_argument("--into", type=Path, metavar="FILE")
    options = parser.parse_args()
    if (data := data_folder()) is None:
        return
    results = []
    for pair in true_pairs(data, options.only):
        print(pair.name, file=sys.stderr)
        results.append(run_program(replace(pair, windows=[], normals=[]) if pair.expected else pair))
    tables = accuracy_tables(results, options.pairs)
    print(tables)
    if options.into:
        write_between(options.into, "accuracy", tables)


if __name__ == "__main__":
    main()
