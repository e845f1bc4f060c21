"""How often the truth lies within the sigmas and intervals that are stated, on rendered terrain.

    python benchmarks/coverage.py [--pairs N] [--into docs/calibration.md]

Renders pairs of random terrain (`sample_data/random_terrain.py`), asks for nine windows of random place and size in
each, and compares the slope of every window with that of the plane nearest to all of its ground, seen in image 2 or
not. With SLOPEMAP_DATA the windows that the rendered pairs below it list are judged in the same way: on terrain smooth
ones of 151 px, and whole grids of 3x3 and 6x6 over craters and rocks; and such grids over panels, towns, a platform and
vehicles, where hardly a window is one plane. --into writes the tables between the marks of a document.
"""

from __future__ import annotations

import argparse
import json
import os
import runpy
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from slopecli.errors import NoAnswer
from slopecli.look import FeatureMemory
from slopecli.options import Options
from slopecli.pipeline import estimate
from slopecli.types import Camera, Image, Report

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent / name) for name in ("sample_data", "tests")]
from random_terrain import GROUNDS, SIDE_PX, TerrainPair, random_pair  # noqa: E402

FloatArray = NDArray[np.float64]
Window = tuple[int, int, int, int]

PAIRS = 7  # of each kind of ground
SIDES_PX = 60, 130  # of windows
MOST_DRAWN, MOST_STEEP = 600, 60  # windows drawn in a pair, and those asked for among them, where only steep ones count
MOSTLY_SEEN = 0.9  # of a window, in image 2; the rest counts as partly seen
LIMIT_DEG = Options().tolerance_deg
TERRAIN, STEPS = ("rendered/A",), ("rendered/B", "rendered/C", "rendered/D09")  # pairs by the beginnings of their names
GRIDS = {"windows_151": "smooth", "windows_3x3": "3x3", "windows_6x6": "6x6"}
MARKS = ("<!-- coverage: begin -->", "<!-- coverage: end -->")


@dataclass(frozen=True)
class Asked:
    """A window of known truth and its answer. normal_deg: angle between the normals; NaN, "none" without an answer."""

    kind: str
    where: str
    true_deg: float
    slope_deg: float = np.nan
    sigma_deg: float = np.nan
    inside: bool = False
    normal_deg: float = np.nan
    verdict: str = "none"
    status: str = "none"
    unresolved: bool = False

    @property
    def standardised(self) -> float:
        return (self.slope_deg - self.true_deg) / self.sigma_deg

    @property
    def well_posed(self) -> bool:
        """Answered, with no second answer and nothing said against it."""
        return self.status == "ok" and not self.unresolved


# ---- answers ----


def ask(
    kinds: list[str],
    windows: list[Window],
    normals: list[FloatArray],
    images: Any,
    camera: Camera,
    where: str,
    memory: FeatureMemory | None = None,
) -> list[Asked]:
    """Ask for the windows of one pair. normals: true ones, towards camera 1; memory: of the pair's features."""
    true = [slope_deg(normal) for normal in normals]
    try:
        report = estimate(*images, camera, camera, Options(windows=tuple(windows)), memory=memory)
    except NoAnswer:
        return [Asked(kind, where, slope) for kind, slope in zip(kinds, true, strict=True)]
    return [answer_of(i, report, *rest, where) for i, rest in enumerate(zip(kinds, normals, true, strict=True), 1)]


def answer_of(number: int, report: Report, kind: str, normal: FloatArray, true_deg: float, where: str) -> Asked:
    plane = next((plane for plane in report.planes if plane.id == number), None)
    if plane is None:
        return Asked(kind, where, true_deg)
    low, high = plane.slope_ci95_deg
    return Asked(
        kind,
        f"{where}:{number}",
        true_deg,
        plane.slope_deg,
        plane.slope_sigma_deg,
        low <= true_deg <= high,
        angle_deg(plane.normal_cam1, normal),
        plane.verdict,
        plane.status,
        report.ambiguity.status == "unresolved",
    )


def angle_deg(a: FloatArray, b: FloatArray) -> float:
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b)))


# ---- scenes ----


def terrain_windows(kind: str, seed: int) -> list[Asked]:
    """Nine windows of one random pair."""
    pair, rng = random_pair(GROUNDS[kind], seed), np.random.default_rng(seed + 10_000)
    return ask_terrain(kind, pair, [random_window(rng) for _ in range(9)], f"{kind}/{seed}")


def steep_windows(kind: str, seed: int) -> list[Asked]:
    """Windows of one random pair, up to MOST_STEEP, that image 2 shows and whose ground is steeper than is safe."""
    pair, rng = random_pair(GROUNDS[kind], seed), np.random.default_rng(seed + 20_000)
    drawn = (random_window(rng) for _ in range(MOST_DRAWN))
    steep = (w for w in drawn if slope_deg(pair.normal(w)) > LIMIT_DEG and pair.visible_share(w) >= MOSTLY_SEEN)
    windows = list(islice(steep, MOST_STEEP))
    return ask_terrain(kind, pair, windows, f"{kind}/{seed}") if windows else []


def random_window(rng: np.random.Generator) -> Window:
    """A square of random side and place."""
    side = int(rng.integers(*SIDES_PX))
    x, y = (int(c) for c in rng.integers(0, SIDE_PX - side, 2))
    return x, y, side, side


def ask_terrain(kind: str, pair: TerrainPair, windows: list[Window], where: str) -> list[Asked]:
    """Ask for windows of a random pair."""
    kinds = [kind if pair.visible_share(window) >= MOSTLY_SEEN else "partly seen" for window in windows]
    c = pair.camera
    camera = Camera(SIDE_PX, SIDE_PX, *(float(c[name]) for name in ("fx", "fy", "cx", "cy")))  # type: ignore[arg-type]
    images = [Image(grey) for grey in pair.images]
    return ask(kinds, windows, [pair.normal(window) for window in windows], images, camera, where)


def slope_deg(normal: FloatArray) -> float:
    """Of a plane by its normal, for a camera that looks down."""
    return angle_deg(normal, np.array([0.0, 0.0, -1.0]))


def data_windows(folder: Path, sets: Sequence[str] = TERRAIN) -> Iterator[Asked]:
    """Windows of sets of the pairs below a folder of rendered pairs, grid by grid."""
    accuracy = runpy.run_path(str(HERE / "accuracy.py"))
    tests = runpy.run_path(str(HERE.parent / "tests" / "test_data_sets.py"))
    for pair in (pair for name in sets for pair in accuracy["true_pairs"](folder, name)):
        truth = json.loads(pair.path.read_text(encoding="utf-8"))
        camera, images = (
            tests["camera_of"](pair.cameras[0]),
            [tests["load_image"](p) for p in (pair.image1, pair.image2)],
        )
        memory = FeatureMemory()
        for grid, name in GRIDS.items():
            listed = truth.get(grid, [])
            kinds = [name if w["visible_fraction"] >= MOSTLY_SEEN else f"{name}, partly seen" for w in listed]
            windows = [(w["x0"], w["y0"], w["x1"] - w["x0"], w["y1"] - w["y0"]) for w in listed]
            normals = [-np.array(w["n"]) for w in listed]
            if listed:
                yield from ask(kinds, windows, normals, images, camera, pair.name, memory)


# ---- tables ----

HEAD = ["ground", "windows", "answered", "RMS z", "median abs z", "within 1 σ", "2 σ", "3 σ", "95 % interval"]
HEAD += ["median error", "median σ", "overconfident", "gentle called safe", "steep called safe"]


def row(name: str, asked: list[Asked]) -> list[str]:
    """Cells: z is the error of the slope over its sigma, of windows that are answered with no second answer open."""
    judged = [a for a in asked if np.isfinite(a.slope_deg) and not a.unresolved]
    z = np.abs([a.standardised for a in judged])
    errors, sigmas = (np.array([getattr(a, field) for a in judged]) for field in ("normal_deg", "sigma_deg"))
    gentle = [a.verdict == "safe" for a in asked if a.true_deg < 10 and a.well_posed]
    steep = [a.verdict == "safe" for a in asked if a.true_deg > LIMIT_DEG]
    over = int((errors > 1 + 4 * sigmas).sum())
    shares = [percent((z <= k).sum(), len(z)) for k in (1, 2, 3)]
    return [
        name,
        str(len(asked)),
        percent(sum(np.isfinite(a.slope_deg) for a in asked), len(asked)),
        f"{np.sqrt(np.mean(z**2)):.2f}",
        f"{np.median(z):.2f}",
        *shares,
        percent(sum(a.inside for a in judged), len(judged)),
        f"{np.median(errors):.2f}°",
        f"{np.median(sigmas):.2f}°",
        str(over),
        f"{sum(gentle)} of {len(gentle)}",
        f"{sum(steep)} of {len(steep)}",
    ]


def percent(count: float, total: int) -> str:
    return f"{100 * count / total:.1f} %" if total else "-"


def table(asked: list[Asked]) -> str:
    kinds = dict.fromkeys(a.kind for a in asked)
    rows = [row(kind, [a for a in asked if a.kind == kind]) for kind in kinds]
    rows.append(row("**all**", asked))
    return "\n".join("| " + " | ".join(line) + " |" for line in [HEAD, ["---"] * len(HEAD), *rows])


def write_into(document: Path, text: str) -> None:
    content = document.read_text(encoding="utf-8")
    before, after = content.split(MARKS[0])[0], content.split(MARKS[1])[1]
    document.write_text(f"{before}{MARKS[0]}\n\n{text}\n\n{MARKS[1]}{after}", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=PAIRS, metavar="N", help="of each kind of ground")
    parser.add_argument("--into", type=Path, metavar="FILE")
    options = parser.parse_args()
    asked = [a for kind in GROUNDS for seed in range(options.pairs) for a in terrain_windows(kind, seed)]
    parts = [table(asked)]
    data = os.environ.get("SLOPEMAP_DATA")
    if data:
        parts += [table(list(data_windows(Path(data), sets))) for sets in (TERRAIN, STEPS)]
    print("\n\n".join(parts))
    if options.into:
        write_into(options.into, "\n\n".join(parts))


if __name__ == "__main__":
    main()
