"""Render a flight over the landing site of `descent/`: a folder of overlapping images to try `slopemap batch` on.

    python sample_data/make_sequence.py FOLDER [--count 201] [--size 320x240]

writes frame_0001.png, frame_0002.png, ... and camera.json. Needs numpy, scipy and OpenCV, and a minute for 201 images.
The same count and size give the same pixels, and a shorter flight is the beginning of a longer one.
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from heightfield import RayCaster
from make_sample_data import write_image, write_json
from numpy.typing import NDArray
from rendering import FloatArray, View, develop, rotation_about
from terrain import CELL, build_terrain

SEED = 40961
HALF_VIEW_DEG = 30.0  # of the image's width
HEIGHT, STEP = 7.0, 1.3  # m above the middle of the site, and from one image to the next: neighbours share about 75 %
MIDDLE_RADIUS, RADIUS_SWING = 3.2, 1.4  # m: the site is 21 m wide, and all of every image shall lie on it
EXPOSURE = 1.35


def positions() -> Iterator[FloatArray]:
    """Where the camera stands, STEP apart: rounds of a slowly swinging radius and height, which never close."""
    angle = 0.0
    while True:
        radius = MIDDLE_RADIUS + RADIUS_SWING * math.sin(0.61 * angle)
        height = HEIGHT + 0.5 * math.sin(0.83 * angle)
        yield np.array([radius * math.cos(angle), radius * math.sin(angle), height])
        angle += STEP / radius


def views(count: int, width: int, height: int) -> Iterator[View]:
    """A camera that looks down and sways by up to three degrees."""
    focal = width / 2 / math.tan(math.radians(HALF_VIEW_DEG))
    down = np.diag([1.0, -1.0, -1.0])
    for number, centre in zip(range(count), positions(), strict=False):
        sway = [3.0 * math.sin(rate * number) for rate in (0.31, 0.23, 0.17)]
        turn = rotation_about("z", sway[2]) @ rotation_about("y", sway[1]) @ rotation_about("x", sway[0])
        yield View(width, height, focal, turn @ down, centre)


def render(view: View, caster: RayCaster, radiance: FloatArray, number: int) -> NDArray[np.uint8]:
    """One ray through every pixel: the light was spread over a pixel's footprint beforehand."""
    u, v = np.meshgrid(np.arange(view.width, dtype=float), np.arange(view.height, dtype=float))
    rays = view.rays(u, v).reshape(-1, 3)
    hits = view.centre + caster.depth(view.centre, rays)[:, None] * rays
    seen = caster.sample(radiance, hits[:, 0], hits[:, 1]).reshape(view.height, view.width)
    return develop(seen, EXPOSURE, np.random.default_rng((SEED, number)))


def make_sequence(folder: Path, count: int, width: int, height: int) -> None:
    """Write the images and their camera file into a folder, which is made if need be."""
    from scipy.ndimage import gaussian_filter

    folder.mkdir(parents=True, exist_ok=True)
    terrain = build_terrain()
    flight = list(views(count, width, height))
    footprint = HEIGHT / flight[0].focal / CELL  # cells
    radiance = gaussian_filter(terrain.radiance, 0.6 * footprint)
    caster = RayCaster(gaussian_filter(terrain.height, 0.3 * footprint), CELL)
    write_json(folder / "camera.json", flight[0].camera_file())
    for number, view in enumerate(flight, 1):
        write_image(folder / f"frame_{number:04d}.png", render(view, caster, radiance, number))


def size(text: str) -> tuple[int, int]:
    match = re.fullmatch(r"(\d+)x(\d+)", text)
    if match is None or min(map(int, match.groups())) < 16:
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT, both at least 16, for example 320x240")
    return int(match[1]), int(match[2])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="where the images go")
    parser.add_argument("--count", type=int, default=201, help="how many images (default 201)")
    parser.add_argument("--size", type=size, default=(320, 240), help="WIDTHxHEIGHT in px (default 320x240)")
    arguments = parser.parse_args()
    if arguments.count < 1:
        parser.error(f"--count is {arguments.count}, needed 1 or more")
    make_sequence(arguments.folder, arguments.count, *arguments.size)


if __name__ == "__main__":
    main()
