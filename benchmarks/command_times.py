"""Processor time and memory of the commands for a pair, all files written, beside a plain OpenCV script.

The script reads the same images, finds SIFT features, matches them with FLANN and fits one essential matrix (PLAIN of
whole_program.py): it has no slope at its end. All are processes of their own, run in turns; of each the least of its
runs counts, start-up of Python included.

    OPENBLAS_NUM_THREADS=1 python benchmarks/command_times.py

The pair of a megapixel is rendered first; the town comes with the sources; the large pair is the rendered one, scaled.
"""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
from large_images import scaled_camera
from whole_program import ROOT, Cost, least_of, megapixel_pair, plain_command

ROUNDS, LARGE = 3, 4  # LARGE: times by which the pair is scaled up, to 17 megapixels


@dataclass(frozen=True)
class Pair:
    """Files of a pair, and its size."""

    image1: Path
    image2: Path
    camera: Path
    megapixels: float

    @classmethod
    def of(cls, image1: Path, image2: Path, camera: Path) -> Pair:
        numbers = json.loads(camera.read_text(encoding="utf-8"))
        return cls(image1, image2, camera, numbers["width"] * numbers["height"] / 1e6)

    def command(self, name: str, folder: str, *more: str) -> list[str]:
        files = [str(self.image1), str(self.image2), "--camera", str(self.camera), "-o", folder]
        return [sys.executable, "-m", "slopecli", name, *files, *more]

    def plain(self) -> list[str]:
        return plain_command(self.image1, self.image2, self.camera, "flann")


def scaled_up(pair: Pair, folder: Path) -> Pair:
    """The pair with pixels `LARGE` times smaller."""
    folder.mkdir()
    for name, path in (("image1", pair.image1), ("image2", pair.image2)):
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        large = cv2.resize(pixels, None, fx=LARGE, fy=LARGE, interpolation=cv2.INTER_CUBIC)
        cv2.imwrite(str(folder / f"{name}.bmp"), large)
    camera = scaled_camera(json.loads(pair.camera.read_text(encoding="utf-8")), LARGE)
    (folder / "camera.json").write_text(json.dumps(camera), encoding="utf-8")
    return Pair.of(folder / "image1.bmp", folder / "image2.bmp", folder / "camera.json")


def middle_window(pair: Pair, side_px: int) -> list[str]:
    numbers = json.loads(pair.camera.read_text(encoding="utf-8"))
    corner = ((numbers[name] - side_px) // 2 for name in ("width", "height"))
    return ["--window", ",".join(map(str, (*corner, side_px, side_px)))]


def row(name: str, cost: Cost, pair: Pair, plain: Cost | None) -> str:
    ratio = "" if plain is None else f" {cost.seconds / plain.seconds:12.2f}x"
    size, seconds, a_megapixel = pair.megapixels, cost.seconds, cost.seconds / pair.megapixels
    return f"{name:32} {size:5.1f} {seconds:10.2f} s {a_megapixel:8.2f} s {cost.peak_mb:9.0f} MB{ratio}"


def report() -> str:
    """The table as text."""
    with tempfile.TemporaryDirectory() as root:
        ground = Pair.of(*megapixel_pair(Path(root, "pair")))
        town = Pair.of(*(ROOT / "sample_data" / "urban" / n for n in ("image1.png", "image2.png", "camera.json")))
        large, out = scaled_up(ground, Path(root, "large")), str(Path(root, "out"))
        rows = {
            "estimate, 3x3 windows": (ground, ground.command("estimate", out)),
            "estimate, one window of 64 px": (ground, ground.command("estimate", out, *middle_window(ground, 64))),
            "estimate, 32x32 windows": (ground, ground.command("estimate", out, "--grid", "32x32")),
            "estimate, 64x64 windows": (ground, ground.command("estimate", out, "--grid", "64x64")),
            "map": (ground, ground.command("map", out)),
            "segment, a town": (town, town.command("segment", out)),
            "map, a large pair": (large, large.command("map", out)),
        }
        commands = {name: command for name, (_, command) in rows.items()}
        costs = least_of(commands | {"ground": ground.plain(), "town": town.plain()}, ROUNDS)
        of_script = {ground: costs["ground"], town: costs["town"]}
        lines = [f"{'':32} {'MP':>5} {'processor':>12} {'a MP':>10} {'peak memory':>12} {'the script':>13}"]
        lines += [row(name, costs[name], pair, of_script.get(pair)) for name, (pair, _) in rows.items()]
        lines += [
            row(f"OpenCV script, {name}", costs[name], pair, None)
            for name, pair in (("ground", ground), ("town", town))
        ]
    return "\n".join(line.rstrip() for line in lines)


if __name__ == "__main__":
    print(report())
