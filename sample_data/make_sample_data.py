"""Render the sample pairs and their truth again: `python sample_data/make_sample_data.py [--output DIR] [SCENE ...]`.

Needs numpy, scipy and OpenCV (to write the PNGs) and about a minute. The same seeds give the same pixels.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from descent_pair import render_descent
from make_depth import descent_depth
from urban_pair import render_urban


def write_json(path: Path, content: dict[str, Any]) -> None:
    """One key per line, and one list entry per line where the entries are objects."""
    lines = []
    for key, value in content.items():
        if isinstance(value, list) and isinstance(value[0], dict):
            text = "[\n    " + ",\n    ".join(json.dumps(entry) for entry in value) + "\n  ]"
        else:
            text = json.dumps(value)
        lines.append(f"  {json.dumps(key)}: {text}")
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def write_image(path: Path, image: Any) -> None:
    """PNG at the strongest compression."""
    if not cv2.imwrite(str(path), image, [cv2.IMWRITE_PNG_COMPRESSION, 9]):
        raise OSError(f"{path}: the image could not be written")


def make_descent(folder: Path) -> None:
    images, camera, truth = render_descent()
    write_pair(folder, images, camera, truth)


def make_urban(folder: Path) -> None:
    images, camera, truth, labels = render_urban()
    write_pair(folder, images, camera, truth)
    write_image(folder / "labels.png", labels)


def make_small_descent(folder: Path) -> None:
    images, camera, _ = render_descent()
    write_small(folder, *made_smaller(images, camera), quality=92)
    side = camera["width"] // 5  # averaged as disparities are, so that the middle of a block is on its plane
    depth = 1.0 / cv2.resize(1.0 / descent_depth().astype(float), (side, side), interpolation=cv2.INTER_AREA)
    write_image(folder / "depth.png", np.rint(1000.0 * depth).astype(np.uint16))  # mm


def make_small_town(folder: Path) -> None:
    images, camera, *_ = render_urban()
    write_small(folder, images, camera)


def made_smaller(images: list[Any], camera: dict[str, Any], share: float = 0.8) -> tuple[list[Any], dict[str, Any]]:
    """The images at a share of their size, with their camera: a first answer should not take long."""
    size = (round(camera["width"] * share), round(camera["height"] * share))
    middle = {name: (camera[name] + 0.5) * share - 0.5 for name in ("cx", "cy")}
    lens = {name: camera[name] * share for name in ("fx", "fy")}
    smaller = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in images]
    return smaller, camera | {"width": size[0], "height": size[1]} | lens | middle


def write_small(folder: Path, images: list[Any], camera: dict[str, Any], quality: int = 85) -> None:
    """A pair as JPEG, a third of the bytes and less, which the package carries."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, image in enumerate(images, 1):
        if not cv2.imwrite(str(folder / f"image{number}.jpg"), image, [cv2.IMWRITE_JPEG_QUALITY, quality]):
            raise OSError(f"{folder}: the image could not be written")
    write_json(folder / "camera.json", camera)


def write_pair(folder: Path, images: list[Any], camera: dict[str, Any], truth: dict[str, Any]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number, image in enumerate(images, 1):
        write_image(folder / f"image{number}.png", image)
    write_json(folder / "camera.json", camera)
    write_json(folder / "truth.json", truth)


SCENES = {"descent": make_descent, "urban": make_urban}
# what slopecli/sample/ holds: `make_sample_data.py --output slopecli sample/descent sample/town`
PACKAGED = {"sample/descent": make_small_descent, "sample/town": make_small_town}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "scenes",
        nargs="*",
        metavar="SCENE",
        help=f"any of {', '.join(SCENES | PACKAGED)}; {' and '.join(SCENES)} by default",
    )
    parser.add_argument("--output", type=Path, default=Path(__file__).parent, help="folder that takes the scenes")
    arguments = parser.parse_args()
    for scene in arguments.scenes or SCENES:
        every = SCENES | PACKAGED
        if scene not in every:
            parser.error(f"no scene named {scene!r}; there are {', '.join(every)}")
        every[scene](arguments.output / scene)


if __name__ == "__main__":
    main()
