"""The pair of images that the package carries, copied to where a user can look at it."""

from __future__ import annotations

from importlib.resources.abc import Traversable
from pathlib import Path

from slopecli.io.outputs import store_outputs

SAMPLE = ("image1.jpg", "image2.jpg", "camera.json")


def copy_sample(source: Traversable, folder: Path) -> tuple[Path, Path, Path]:
    """Copy image 1, image 2 and their camera file to a folder, as `store_outputs`; returns their paths."""
    first, second, camera = store_outputs({name: (source / name).read_bytes() for name in SAMPLE}, folder, SAMPLE)
    return first, second, camera
