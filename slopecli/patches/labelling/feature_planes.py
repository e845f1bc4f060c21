"""The finder `ransac`: planes among the dense matches of the overview alone; no pixels are compared.

Source: Cheng, experiment 2. Departs from the paper: planes are not found one after the other, but chosen together by
one energy.
"""

from __future__ import annotations

import cv2
import numpy as np

from slopecli.errors import NoAnswer
from slopecli.geometry.epipolar import homogeneous
from slopecli.look.dense import CELL
from slopecli.look.gradient_components import Labels, renumbered_by_size
from slopecli.look.matches import MIN_ON_PLANE, Evidence
from slopecli.look.noise import OVERVIEW_CELL_PX
from slopecli.look.scene import Scene
from slopecli.options import Options
from slopecli.patches.labelling.depth_planes import DepthPlanes, robust_planes
from slopecli.patches.labelling.energy import Energy, neighbour_costs
from slopecli.patches.labelling.labelling_tunables import LABELLING
from slopecli.patches.labelling.search import State, make_pool, search, settled
from slopecli.patches.neighbours import nearest
from slopecli.patches.patch import Footprint, Found, Patch, region_footprints, weight_of
from slopecli.types import FloatArray, IntArray


def find_feature_planes(scene: Scene, options: Options) -> Found:
    """Return planes among the dense matches of the overview, largest first; a footprint is where the matches lie.

    Raises
    ------
    NoAnswer : no plane has enough matches.
    """
    share = options.min_region_percent / 100
    least = max(2 * MIN_ON_PLANE, share * scene.shape1[0] * scene.shape1[1] / _cell_area(scene))
    label, _ = renumbered_by_size(label_cells(scene.evidence, options.seed), least)
    if not label.any():
        raise NoAnswer(
            "low-texture",
            f"none of the {len(scene.evidence)} matches lie on a common plane",
            "give images with more texture, or windows with --planes windows",
        )
    members = [np.flatnonzero(label == k) for k in range(1, int(label.max()) + 1)]
    footprints = region_footprints(_painted(members, scene), scene.shape1)
    return Found([_patch(k, *pair, scene) for k, pair in enumerate(zip(footprints, members, strict=True), 1)])


def label_cells(evidence: Evidence, seed: int) -> IntArray:
    """Return labels (n,) of the matches of the overview: 1..k by plane, 0 for none. A plane may be in pieces.

    Planes are sought among some of the matches, then all are labelled.
    """
    px = evidence.leverage * evidence.focal_px
    rows, target = homogeneous(evidence.x1) * px[:, None], evidence.w * px
    cells = DepthPlanes(rows, target, np.zeros(len(px)), LABELLING.ransac_scale_px)
    rng = np.random.default_rng(seed)
    part = np.sort(rng.permutation(len(px))[: LABELLING.ransac_points])
    if len(part) < 2 * MIN_ON_PLANE:
        return np.zeros(len(px), np.int64)
    found = _search(cells.take(part), evidence.uv1[part], rng)
    if len(part) == len(px):
        return found.labels
    near = nearest(evidence.uv1, 1 + LABELLING.neighbours)[:, 1:]
    return settled(cells, _energy(cells, near), found.planes, found.scale).labels


def _search(cells: DepthPlanes, uv1: FloatArray, rng: np.random.Generator) -> State:
    near = nearest(uv1, 1 + LABELLING.ransac_around)
    energy = _energy(cells, near[:, 1 : 1 + LABELLING.neighbours])
    around = near[rng.permutation(len(uv1))[: LABELLING.ransac_judges]]
    planes = robust_planes(cells.rows[around], cells.target[around], cells.bounds)
    judges = rng.permutation(len(uv1))[: LABELLING.ransac_judges]
    return search(cells, energy, make_pool(cells, planes, np.arange(len(planes)), judges, energy.none))


def _energy(cells: DepthPlanes, near: IntArray) -> Energy:
    """Return the energy; the depth of a cell on no plane may be any that the scene shows."""
    low, high = np.quantile(cells.target, [0.01, 0.99])
    none = float(np.log(max(high - low, 10 * cells.bounds[0])))
    return Energy(neighbour_costs(near, 2.0 * LABELLING.smooth), none, LABELLING.plane)


def _cell_area(scene: Scene) -> float:
    """Return px of image 1 in a cell of the overview."""
    return float(CELL**2 / np.prod(scene.pyramid1.overview_scale))


def _painted(members: list[IntArray], scene: Scene) -> Labels:
    """Return (h, w) labels 1..k of the cells of each plane's matches; gaps between cells of one plane are closed."""
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
