"""Write two photographs of a rendered face of rock, from a step aside, to try strike and dip on.

    python sample_data/make_rock_pair.py outcrop

writes outcrop/face1.jpg and face2.jpg, whose EXIF states the focal length as a camera does, and truth.json: dip, dip
direction and strike of the four planes in sight, a bedding plane above, two joints, and an overhang below. Camera 1
is held level towards 135 degrees (south-east), camera 2 1.2 m to its right. Needs numpy, SciPy, Pillow, and a second.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from materials import Grain
from numpy.typing import NDArray
from PIL import Image
from PIL.TiffImagePlugin import IFDRational
from rendering import FloatArray, View, area_filter, develop, motion_truth, rotation_about, subpixel_offsets

SEED = 31
SUPERSAMPLING = 2
WIDTH, HEIGHT = 720, 540
FOCAL_MM, SENSOR_MM = 24.0, 25.0  # of the width
HEADING_DEG = 135.0
BASELINE_M = 1.2
BED_M = 0.28  # thickness of the beds whose edges show on the joints
NAMES = ("face1.jpg", "face2.jpg")
SUN = np.array([-0.25, 0.75, 0.6]) / np.linalg.norm([-0.25, 0.75, 0.6])  # world: x east, y north, z up


@dataclass(frozen=True)
class Face:
    """A plane: its dip and dip direction, degrees, and a point of it, m right, down and ahead of camera 1.

    overhangs : whether what is seen of it faces down.
    """

    name: str
    dip_deg: float
    dip_direction_deg: float
    point: tuple[float, float, float]
    overhangs: bool = False

    @property
    def normal(self) -> FloatArray:
        """(3,) unit, world, out of the rock."""
        dip, azimuth = np.deg2rad([self.dip_deg, self.dip_direction_deg])
        upward = np.array([np.sin(dip) * np.sin(azimuth), np.sin(dip) * np.cos(azimuth), np.cos(dip)])
        return -upward if self.overhangs else upward


FACES = (
    Face("bedding", 38.0, 300.0, (0.0, -0.6, 9.0)),
    Face("joint, left", 84.0, 5.0, (0.1, 0.0, 9.0)),
    Face("joint, right", 72.0, 268.0, (0.1, 0.0, 9.0)),
    Face("overhang", 75.0, 130.0, (0.0, 0.9, 9.0), overhangs=True),
)


def views() -> tuple[View, View]:
    """Both cameras: the first level, the second a step to the right, held by hand and turned back towards the face."""
    heading = np.deg2rad(HEADING_DEG)
    right = np.array([np.cos(heading), -np.sin(heading), 0.0])
    ahead = np.array([np.sin(heading), np.cos(heading), 0.0])
    first = np.stack([right, [0.0, 0.0, -1.0], ahead])
    turn = rotation_about("z", 0.8) @ rotation_about("y", 5.5) @ rotation_about("x", -0.6)
    step = np.array([1.0, -0.05, 0.08])
    centre = first.T @ (BASELINE_M * step / np.linalg.norm(step))
    focal = FOCAL_MM / SENSOR_MM * WIDTH
    return View(WIDTH, HEIGHT, focal, first, np.zeros(3)), View(WIDTH, HEIGHT, focal, turn @ first, centre)


def met(rays: FloatArray, centre: FloatArray, origin: View) -> tuple[FloatArray, NDArray[np.int64]]:
    """World points (n, 3) at which rays (n, 3) enter the rock, the solid behind all faces, and the face of each."""
    depths = []
    for face in FACES:
        point = np.array(face.point) @ origin.rotation
        towards = rays @ face.normal
        depths.append(np.where(towards < 0, (face.normal @ (point - centre)) / towards, -np.inf))
    which = np.argmax(depths, axis=0)
    return centre + np.max(depths, axis=0)[:, None] * rays, which


def radiance(view: View, origin: View, grain: Grain, layers: FloatArray) -> FloatArray:
    """Radiance image (h, w, 3), RGB, of a view."""
    offsets = subpixel_offsets(SUPERSAMPLING)
    u, v = ((np.arange(n)[:, None] + offsets).ravel() for n in (view.width, view.height))
    rays = view.rays(*np.meshgrid(u, v)).reshape(-1, 3)
    points, which = met(rays, view.centre, origin)
    bed = np.interp(points @ FACES[0].normal / BED_M, np.arange(-100, 100), layers)
    light = np.zeros(len(points))
    for index, face in enumerate(FACES):
        on = which == index
        tangents = np.linalg.svd(face.normal[None, :])[2][1:]
        s, t = tangents @ points[on].T
        gain = sum(
            strength * grain.noise(layer, s, t, index)
            for layer, strength in (("fine", 0.12), ("medium", 0.16), ("broad", 0.12))
        )
        own = np.zeros(on.sum()) if index == 0 else bed[on]  # a bedding plane is one bed
        light[on] = np.exp(gain + own) * (0.5 + 0.5 * np.clip(face.normal @ SUN, 0, None))
    colour = light[:, None] * np.array([0.46, 0.41, 0.34])
    return area_filter(colour.reshape(len(v), len(u), 3), SUPERSAMPLING)


def exif() -> Image.Exif:
    """What a camera states of its focal length: millimetres, and pixels per centimetre of its sensor."""
    block = Image.Exif()
    block[0x010F], block[0x0110] = "slopemap", "rendered camera"
    density = IFDRational(round(1e4 * 10 * WIDTH / SENSOR_MM), 10_000)
    block[0x8769] = {
        37386: IFDRational(round(10 * FOCAL_MM), 10),
        40962: WIDTH,
        40963: HEIGHT,
        41486: density,
        41487: density,
        41488: 3,
    }
    return block


def truth(first: View, second: View) -> dict[str, Any]:
    """truth.json: motion and planes."""
    planes = [
        {
            "name": face.name,
            "dip_deg": face.dip_deg,
            "dip_direction_deg": face.dip_direction_deg,
            "strike_deg": (face.dip_direction_deg - 90.0) % 360.0,
            "overhangs": face.overhangs,
            "normal_cam1": (first.rotation @ face.normal).round(9).tolist(),
            "distance_m": round(float(-face.normal @ (np.array(face.point) @ first.rotation)), 6),
        }
        for face in FACES
    ]
    return {**motion_truth(first, second), "planes": planes}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="where the files go")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(SEED)
    grain, layers, both = Grain(rng), 0.25 * rng.standard_normal(200), views()
    for view, name in zip(both, NAMES, strict=True):
        picture = develop(radiance(view, both[0], grain, layers), 1.0, rng)
        Image.fromarray(picture).save(folder / name, "JPEG", quality=92, exif=exif())
    (folder / "truth.json").write_text(json.dumps(truth(*both), indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
