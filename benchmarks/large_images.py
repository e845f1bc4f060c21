"""Processor time, peak memory and change of the answer when a pair is scaled up to 20 megapixels.

Images (bicubic), camera and windows are scaled alike, so both runs see the same ground and must give the same slopes.

    python benchmarks/large_images.py

takes a drone pair below SLOPEMAP_DATA, the folder that holds `real/`, or the sample pair where that is not set.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from whole_program import SAMPLE, Cost, cost_of, estimate_command

MEGAPIXELS = 20.0
MAX_SECONDS, MAX_PEAK_MB, MAX_CHANGE_DEG = 20.0, 2500.0, 0.3
SURE_DEG = 1.0  # windows that image 2 hardly shows are uncertain by more, and may change by as much
DRONE = Path("real/drone-copr-beach/IMG_0031__IMG_0034.truth.json")
INTRINSICS = ("fx", "fy", "cx", "cy")


def find_pair() -> tuple[Path, Path, dict[str, Any]]:
    """Both images, and the native camera of both."""
    data = os.environ.get("SLOPEMAP_DATA")
    if not data:
        camera = json.loads((SAMPLE / "camera.json").read_text(encoding="utf-8"))
        return SAMPLE / "image1.png", SAMPLE / "image2.png", camera
    truth = json.loads((Path(data) / DRONE).read_text(encoding="utf-8"))
    folder, K, (width, height) = (Path(data) / DRONE).parent, truth["K1"], truth["size1"]
    numbers = dict(zip(INTRINSICS, (K[0][0], K[1][1], K[0][2], K[1][2]), strict=True))
    camera = {"width": width, "height": height, **numbers, "distortion": truth["dist1"]}
    return folder / truth["image1"], folder / truth["image2"], camera


def scaled_camera(camera: dict[str, Any], factor: int) -> dict[str, Any]:
    """Pixel centres are at integers, so the centre of the scaled image's first pixel is not that of the original's."""
    fx, fy, cx, cy = (camera[name] for name in INTRINSICS)
    centre = ((cx + 0.5) * factor - 0.5, (cy + 0.5) * factor - 0.5)
    sizes = {"width": camera["width"] * factor, "height": camera["height"] * factor}
    return {**camera, **sizes, **dict(zip(INTRINSICS, (fx * factor, fy * factor, *centre), strict=True))}


def grid(camera: dict[str, Any], factor: int) -> list[str]:
    """Nine windows of the original, scaled."""
    width, height = camera["width"] // 3, camera["height"] // 3
    corners = [(column * width, row * height) for row in range(3) for column in range(3)]
    values = [(x * factor, y * factor, width * factor, height * factor) for x, y in corners]
    return [argument for window in values for argument in ("--window", ",".join(map(str, window)))]


def prepare(folder: Path, images: tuple[Path, Path], camera: dict[str, Any], factor: int) -> list[str]:
    """Write the pair at `factor` times its size; returns the command that estimates its slopes."""
    folder.mkdir()
    written = []
    for name, path in zip(("first", "second"), images, strict=True):
        pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION)
        large = cv2.resize(pixels, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
        written.append(folder / f"{name}.bmp")  # quick to write; reading is all that is timed
        cv2.imwrite(str(written[-1]), large)
    (folder / "camera.json").write_text(json.dumps(scaled_camera(camera, factor)), encoding="utf-8")
    return estimate_command(written[0], written[1], folder / "camera.json", str(folder), *grid(camera, factor))


def answer(folder: Path) -> dict[int, dict[str, Any]]:
    planes = json.loads((folder / "slopes.json").read_text(encoding="utf-8"))["planes"]
    return {plane["id"]: plane for plane in planes}


def differences(small: dict[int, dict[str, Any]], large: dict[int, dict[str, Any]]) -> tuple[list[float], list[float]]:
    """Change of slope and angle between the normals, degrees, of the windows that are well known in both."""
    both = [(small[i], large[i]) for i in sorted(small.keys() & large.keys())]
    both = [(a, b) for a, b in both if max(a["slope_sigma_deg"], b["slope_sigma_deg"]) < SURE_DEG]
    slopes = [abs(a["slope_deg"] - b["slope_deg"]) for a, b in both]
    normals = [math.degrees(math.asin(np.linalg.norm(np.cross(a["normal_cam1"], b["normal_cam1"])))) for a, b in both]
    return slopes, normals


def describe(name: str, camera: dict[str, Any], factor: int, cost: Cost) -> str:
    megapixels = camera["width"] * camera["height"] * factor**2 / 1e6
    return f"{name:9} {megapixels:6.1f} MP {cost.seconds:9.2f} s {cost.peak_mb:9.0f} MB"


def main() -> None:
    image1, image2, camera = find_pair()
    factor = math.ceil(math.sqrt(MEGAPIXELS * 1e6 / (camera["width"] * camera["height"])))
    print(f"{image1.name}, {image2.name}, {factor} times larger\n{'':16} {'processor':>14} {'peak memory':>12}")
    answers = []
    with tempfile.TemporaryDirectory() as root:
        for name, times in (("original", 1), ("scaled up", factor)):
            folder = Path(root) / name
            cost = cost_of(prepare(folder, (image1, image2), camera, times))
            print(describe(name, camera, times, cost))
            answers.append(answer(folder))
    slopes, normals = differences(*answers)
    print(f"goals, scaled up: below {MAX_SECONDS:g} s and {MAX_PEAK_MB:g} MB")
    print(f"windows answered: {len(answers[0])} and {len(answers[1])}; sigma below {SURE_DEG:g} deg: {len(slopes)}")
    if slopes:
        print(f"largest change, deg: slope {max(slopes):.2f}, normal {max(normals):.2f} (goal {MAX_CHANGE_DEG:g})")


if __name__ == "__main__":
    main()
