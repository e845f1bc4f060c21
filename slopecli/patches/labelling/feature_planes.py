"""Planes of matches alone, how many there are being unknown: no pixel is compared.

Source: Cheng, experiment 2. Departs from the paper: not one plane after the other, but all chosen by one energy.
"""

from __future__ import annotations

import cv2
import numpy as np

from slopecli.errors import NoAnswer
from slopecli.look.gradient_components import Labels
from slopecli.look.noise import OVERVIEW_CELL_PX
from slopecli.look.overview import CELL
from slopecli.look.scene import Scene
from slopecli.options import Options
from slopecli.patches.footprint import Footprint, region_footprints
from slopecli.patches.labelling.scene_planes import label_scene_planes
from slopecli.patches.patch import Found, Patch, weight_of
from slopecli.types import IntArray

LEAST_MATCHES = 12  # through fewer a plane is hardly more than chance


def find_feature_planes(scene: Scene, options: Options) -> Found:
    """Planes among the dense matches of the overview, largest first; a plane's footprint is where its matches lie.

    Raises
    ------
    NoAnswer : no plane has enough matches.
    """
    e = scene.evidence
    label, _ = label_scene_planes(e.x1, e.w, e.leverage, e.uv1, e.focal_px, options.seed)
    share = options.min_region_percent / 100
    least = max(LEAST_MATCHES, share * scene.shape1[0] * scene.shape1[1] / _cell_area(scene))
    kept = [k for k in range(int(label.max(initial=-1)) + 1) if np.count_nonzero(label == k) >= least]
    if not kept:
        raise NoAnswer(
            "low-texture",
            f"none of the {len(e)} matches lie on a common plane",
            "give images with more texture, or windows with --planes windows",
        )
    members = [np.flatnonzero(label == k) for k in kept]
    footprints = region_footprints(_painted(members, scene), scene.shape1)
    return Found([_patch(k, *pair, scene) for k, pair in enumerate(zip(footprints, members, strict=True), 1)])


def _cell_area(scene: Scene) -> float:
    """Full px a cell of the overview stands for."""
    return float(CELL**2 / np.prod(scene.pyramid1.overview_scale))


def _painted(members: list[IntArray], scene: Scene) -> Labels:
    """(h, w) 1..k around the matches of each plane, in cells; gaps between cells of one plane closed."""
    uv1 = scene.evidence.uv1
    side = np.sqrt(_cell_area(scene))
    rows, columns = (int(np.ceil(n / side)) for n in scene.shape1)
    layers = np.zeros((len(members), rows, columns), np.uint8)
    for layer, which in zip(layers, members, strict=True):
        at = np.clip(((uv1[which, ::-1] + 0.5) / side).astype(int), 0, [rows - 1, columns - 1])
        layer[at[:, 0], at[:, 1]] = 1
        layer[:] = np.maximum(layer, cv2.morphologyEx(layer, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8)))
    cells = np.where(layers.any(0), layers.argmax(0) + 1, 0)
    size = (round(columns * side), round(rows * side))
    full = cv2.resize(cells.astype(np.uint16), size, interpolation=cv2.INTER_NEAREST)
    full = cv2.copyMakeBorder(full, 0, 1, 0, 1, cv2.BORDER_REPLICATE)
    return np.asarray(full[: scene.shape1[0], : scene.shape1[1]], np.int32)


def _patch(number: int, footprint: Footprint, which: IntArray, scene: Scene) -> Patch:
    e = scene.evidence
    sigma = OVERVIEW_CELL_PX / float(scene.pyramid1.overview_scale.mean())
    cell = np.floor((e.uv1[which, ::-1] + 0.5) / np.sqrt(_cell_area(scene))).astype(np.int64)
    share = min(1.0, len(which) * _cell_area(scene) / max(footprint.area_px, 1))
    weight = weight_of(np.full(len(which), sigma**2))
    return Patch(number, "ransac", footprint, e.take(which), weight, cell, "own", score=1.0, share=share)
