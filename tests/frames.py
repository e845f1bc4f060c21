"""Frames of a rendered descent over the four faces of a pyramid, for tests of sequences."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from scenery import Grey, Surface, make_camera, render, turn

from slopecli.types import Camera, FloatArray

CAMERA: Camera = make_camera(320, 240)
STEP = np.array([0.35, 0.2, 0.92]) / np.linalg.norm([0.35, 0.2, 0.92])  # of the camera from frame to frame
HEIGHT = 22.0  # of the first frame, in steps
# a flat pyramid, whose faces meet on the axes: a step would blur what is tracked beside it
NORMALS = np.array([[-0.12, -0.08, 1.0], [0.12, -0.08, 1.0], [-0.12, 0.08, 1.0], [0.12, 0.08, 1.0]]) / HEIGHT
GRID = "2x2"


def true_normals() -> FloatArray:
    """(4, 3) unit, out of the surface."""
    return -NORMALS / np.linalg.norm(NORMALS, axis=1, keepdims=True)


@cache
def frame(number: int) -> Grey:
    """Frame 0, 1, 2, ... of the descent; each turns the camera a little."""
    w, h = CAMERA.width // 2, CAMERA.height // 2
    ground = [
        Surface(normal, (float(w * (i % 2)), float(h * (i // 2)), float(w), float(h)))
        for i, normal in enumerate(NORMALS)
    ]
    R = turn(0.3 * np.sin(number), 0.4 * np.sin(0.7 * number), 0.5 * number)
    pair = render(R, STEP * number, ground, noise=1.0, noise_seed=number) if number else None
    if pair is not None:
        return pair.grey2
    return render(turn(), STEP, ground, noise=1.0, noise_seed=0).grey1


def write_frames(folder: Path, count: int) -> list[str]:
    """The first frames as files frame1.png, ..., and the camera as camera.json; their names."""
    folder.mkdir(parents=True, exist_ok=True)
    names = [str(folder / f"frame{number + 1}.png") for number in range(count)]
    for number, name in enumerate(names):
        cv2.imwrite(name, frame(number))
    values = {name: float(getattr(CAMERA, name)) for name in ("fx", "fy", "cx", "cy")}
    values |= {"width": CAMERA.width, "height": CAMERA.height}
    (folder / "camera.json").write_text(json.dumps(values), encoding="utf-8")
    return names
