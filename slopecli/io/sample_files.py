"""The pairs of images that the package carries, copied to where a user can look at them."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

from slopecli.io.outputs import store_outputs

PAIR = ("image1.jpg", "image2.jpg", "camera.json")
TRUTH = "depth.png"  # of the descent: true depth of image 1, mm


def copy_sample(scene: str, folder: Path) -> list[Path]:
    """Copy image 1, image 2, their camera file and the true depth, if there is one, to a folder, as `store_outputs`.

    scene : "descent", a landing site, or "town". Returns the paths in that order.
    """
    source = resources.files("slopecli") / "sample" / scene
    names = [name for name in (*PAIR, TRUTH) if (source / name).is_file()]
    return store_outputs({name: (source / name).read_bytes() for name in names}, folder, (*PAIR, TRUTH))
