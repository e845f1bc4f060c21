"""Write the true depth of every pixel of image 1 of `descent/`, to try `slopemap validate` on.

    python sample_data/make_depth.py depth.npy

writes an (800, 800) float32 array: metres along the axis of camera 1. Needs numpy, scipy and OpenCV, and a few seconds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from descent_pair import descent_views
from heightfield import RayCaster
from numpy.typing import NDArray
from terrain import CELL, build_terrain


def descent_depth() -> NDArray[np.float32]:
    """Depth (h, w) of the ground at the pixel centres of image 1, m along the axis of its camera."""
    view, _ = descent_views()
    rays = view.rays(*np.meshgrid(np.arange(view.width), np.arange(view.height)))
    caster = RayCaster(build_terrain().height, CELL)
    rows = [caster.depth(view.centre, row) for row in rays]  # of rays whose length along the axis is 1
    return np.stack(rows).astype(np.float32)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file", type=Path, help="where the depth goes, an .npy file")
    np.save(parser.parse_args().file, descent_depth())


if __name__ == "__main__":
    main()
