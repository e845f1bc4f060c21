"""Quick pairs for tests of batches: the sample images made small, one after the other with noise of their own."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from slopecli.batch import CameraChoice, Job, Keep, Pair
from slopecli.options import Options

DESCENT = Path(__file__).resolve().parent.parent / "sample_data" / "descent"
SIDE = 128  # px; nine windows still have an answer
NOISE_GREY = 1.5


def make_images(folder: Path, count: int) -> list[Path]:
    """A sequence of views, descending and ascending in turn, and camera.json beside them."""
    folder.mkdir(parents=True, exist_ok=True)
    views = [cv2.imread(str(DESCENT / f"image{k}.png"), cv2.IMREAD_COLOR) for k in (1, 2)]
    small = [cv2.resize(view, (SIDE, SIDE), interpolation=cv2.INTER_AREA) for view in views]
    paths = [folder / f"view{k:03d}.png" for k in range(count)]
    for k, path in enumerate(paths):
        noise = np.random.default_rng(k).normal(0.0, NOISE_GREY, small[0].shape)
        cv2.imwrite(str(path), np.clip(small[k % 2] + noise, 0, 255).astype(np.uint8))
    camera = json.loads((DESCENT / "camera.json").read_text())
    (folder / "camera.json").write_text(json.dumps(camera))
    return paths


def make_pairs(images: Sequence[Path], camera: Path | None = None) -> list[Pair]:
    """Every image with the next."""
    choice = CameraChoice(file=str(camera or images[0].parent / "camera.json"))
    return [make_pair(first, second, choice) for first, second in pairwise(images)]


def make_pair(first: Path, second: Path, choice: CameraChoice) -> Pair:
    return Pair(f"{first.stem}-{second.stem}", str(first), str(second), choice, choice)


def make_job(pair: Pair, folder: Path, options: Options = Options(), keep: frozenset[str] = Keep()) -> Job:
    return Job(pair, options, keep, str(folder / pair.name))


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below a folder by its path, hidden ones too."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
