"""The urban procedure: every plane of the scene found in the image itself, with the pixels that lie on it.

Source: Cheng, experiment 3, steps 1-7. Departs from the paper: components of low gradient propose planes rather than
being them, since a textured facade is all gradient; neighbourhoods of dense matches propose others; and which pixel
lies on which plane is decided last, for all planes at once, by how well each transfers it into image 2.
"""

from __future__ import annotations

import cv2
import numpy as np

from slopecli.errors import NoAnswer
from slopecli.look.dense import Cells
from slopecli.look.gradient_components import (
    Labels,
    adaptive_threshold,
    connected_components,
    resized,
    smooth_gradient,
    without_small_pieces,
)
from slopecli.look.scene import Scene, whole_grid
from slopecli.look.threads import single_threaded
from slopecli.look.transfer_error import Comparison
from slopecli.look.warp import Grid
from slopecli.options import Options
from slopecli.patches.footprint import region_footprints
from slopecli.patches.patch import Found, Patch
from slopecli.patches.regions.block_labels import BorderCost, enlarged, label_blocks, surroundings
from slopecli.patches.regions.cell_planes import component_planes, fewest_planes, neighbourhood_planes, region_cells
from slopecli.patches.regions.merging import Labelled, merged, refitted
from slopecli.patches.regions.region_match import CELL, match_labelled, match_regions
from slopecli.patches.regions.review import reviewed
from slopecli.types import FloatArray, Segmentation

WORKING_PIXELS = 5.0e5  # of image 1 that are labelled; borders of planes are as exact as that
SKETCH_PIXELS = 1.25e5  # on which the many proposals first compete
LEAST_COMPONENT = 5e-4  # share of the image: smaller components propose no plane
LEAST_SKETCHED = 1e-3  # share of the image below which a plane is dropped while others are sought
LEAST_PIECE = 3e-4  # share of the image: smaller pieces of a plane are accidents
# of labelling: px a side of the blocks, the step between px of them that are compared, and the least region that stays,
# in shares of the least that is reported
ROUNDS = ((4, 2, 0.4), (4, 2, 1.0), (4, 1, 1.0))


def find_regions(scene: Scene, options: Options) -> Found:
    """Planes of the scene, largest first, each with its pixels and its own matches.

    Raises
    ------
    NoAnswer : no plane holds as much of the image as a region must.
    """
    rng = np.random.default_rng(options.seed)
    grid = whole_grid(scene, WORKING_PIXELS)
    # steps 1-3: gradient, threshold, components
    gradient = smooth_gradient(grid.grey)
    threshold = options.gradient_threshold or adaptive_threshold(gradient)
    components = connected_components(gradient, threshold, LEAST_COMPONENT * gradient.size)
    # steps 4-7: planes of components and neighbourhoods, neighbours that one plane transfers merged
    with single_threaded():
        proposals = _proposed_planes(scene, components, grid, rng)
        found = _labelled(scene, grid, proposals, gradient, threshold, options, rng)
        _refuse_without(bool(found.planes), options)
        labels, cells = match_labelled(found.labels, found.planes, scene)
    labels = _borne_out(labels, cells, scene, options, rng)
    patches = [Patch(k, "region", footprint) for k, footprint in enumerate(region_footprints(labels, scene.shape1), 1)]
    segmentation = Segmentation(gradient, threshold, components, resized(labels, grid.shape))
    return Found(match_regions(labels, cells, patches, scene), segmentation)


def _borne_out(labels: Labels, cells: Cells, scene: Scene, options: Options, rng: np.random.Generator) -> Labels:
    """The labels that matches bear out, see `reviewed`."""
    evidence, which = region_cells(cells, scene)
    least_px = options.min_region_percent / 100 * labels.size
    labels = reviewed(labels, evidence, cells.index[which] * CELL + CELL // 2, CELL, least_px, rng)
    _refuse_without(bool(labels.any()), options)
    return labels


def _refuse_without(planes: bool, options: Options) -> None:
    if not planes:
        raise NoAnswer(
            "low-texture",
            f"no plane explains {options.min_region_percent:g} % of image 1",
            "give images with more texture or more overlap, or a smaller --min-region",
        )


def _comparison(scene: Scene, grid: Grid) -> Comparison:
    return Comparison(
        grid,
        scene.rays1,
        scene.pixels2,
        scene.R,
        scene.T,
        scene.pyramid2,
        scene.shape2,
        (scene.camera1.focal_px, scene.camera2.focal_px),
    )


def _proposed_planes(scene: Scene, components: Labels, grid: Grid, rng: np.random.Generator) -> list[FloatArray]:
    """Scaled normals (3,) of planes the dense matches suggest."""
    cells, _ = region_cells(scene.cells, scene)
    nearby = neighbourhood_planes(cells, rng)
    return [*fewest_planes(cells, nearby), *component_planes(cells, components, grid, nearby)]


def _labelled(
    scene: Scene,
    grid: Grid,
    planes: list[FloatArray],
    gradient: np.ndarray,
    threshold: float,
    options: Options,
    rng: np.random.Generator,
) -> Labelled:
    """Planes compete for the pixels, are fitted to what they won and merged, and compete again, ever finer."""
    comparison = _comparison(scene, grid)
    labels = _sketch(scene, planes, gradient, threshold, grid)
    found = Labelled(planes, labels).by_size(LEAST_SKETCHED * labels.size)
    borders = BorderCost.along_edges(gradient, threshold)
    for side, step, share in ROUNDS:
        found = merged(comparison, refitted(comparison, found, rng), options.merge_px, rng)
        boxes = surroundings(found.labels, len(found.planes))
        blocks = label_blocks(comparison, found.planes, borders, side, step, boxes)
        # planes that hold crumbs only go, and next time the others compete for those
        labels = enlarged(without_small_pieces(blocks, LEAST_PIECE * blocks.size), side, grid.shape)
        found = Labelled(found.planes, labels).by_size(share * options.min_region_percent / 100 * labels.size)
    return merged(comparison, found, options.merge_px, rng)


def _sketch(scene: Scene, planes: list[FloatArray], gradient: np.ndarray, threshold: float, grid: Grid) -> Labels:
    """(h, w) labels of all proposals at low resolution, where trying many planes is cheap."""
    small = whole_grid(scene, SKETCH_PIXELS)
    size = (small.shape[1], small.shape[0])
    coarse = np.asarray(cv2.resize(gradient, size, interpolation=cv2.INTER_AREA), np.float32)
    borders = BorderCost.along_edges(coarse, threshold)
    labels = enlarged(label_blocks(_comparison(scene, small), planes, borders, 3), 3, small.shape)
    return resized(labels, grid.shape)
