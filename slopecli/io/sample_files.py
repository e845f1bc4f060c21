"""The pairs of images that the package carries, copied to where a user can look at them."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from slopecli.io.outputs import store_outputs

SAMPLE = ("image1.jpg", "image2.jpg", "camera.json")


def copy_sample(scene: str, folder: Path) -> tuple[Path, Path, Path]:
    """Copy image 1, image 2 and their camera file to a folder, as `store_outputs`; returns their paths.

    scene : "descent", a landing site, or "town".
    """
    source = resources.files("slopecli") / "sample" / scene
    first, second, camera = store_outputs({name: (source / name).read_bytes() for name in SAMPLE}, folder, SAMPLE)
    return first, second, camera
