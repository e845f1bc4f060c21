"""The finder `regions`: planes of a scene, each with the pixels of image 1 that lie on it.

Source: Cheng, experiment 3, steps 1-7. Departs from the paper: components of low gradient only propose planes, as do
neighbourhoods of dense matches, since a textured facade is all gradient and forms no component. Pixels are assigned to
all planes at once, by how well each plane transfers them into image 2.
"""

from __future__ import annotations

import cv2
import numpy as np

from slopecli.errors import NoAnswer
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
from slopecli.look.warp import FloatImage, Grid
from slopecli.options import Options
from slopecli.patches.patch import Found, Patch, region_footprints
from slopecli.patches.regions.block_labels import BorderCost, enlarged, label_blocks, surroundings
from slopecli.patches.regions.cell_planes import component_planes, fewest_planes, neighbourhood_planes, region_cells
from slopecli.patches.regions.merging import Labelled, merged, refitted
from slopecli.patches.regions.region_match import match_labelled, match_regions
from slopecli.patches.regions.region_tunables import REGION
from slopecli.patches.regions.review import reviewed
from slopecli.types import FloatArray, Segmentation


def find_regions(scene: Scene, options: Options) -> Found:
    """Return the planes of a scene, largest first, each with its footprint and its matches.

    Raises
    ------
    NoAnswer : no plane has `min_region_percent` of the pixels of image 1.
    """
    rng = np.random.default_rng(options.seed)
    grid = whole_grid(scene, REGION.working_pixels)
    # steps 1-3: gradient, threshold, components
    gradient = smooth_gradient(grid.grey)
    threshold = options.gradient_threshold or adaptive_threshold(gradient)
    components = connected_components(gradient, threshold, REGION.least_share * gradient.size)
    # steps 4-7: planes of components and of neighbouring matches proposed, merged where one fits two, given pixels
    with single_threaded():
        proposals = _proposed_planes(scene, components, grid, rng)
        found = _label_pixels(scene, grid, proposals, gradient, threshold, options, rng)
        _check_any(found.labels, options)
        labels, cells = match_labelled(found.labels, found.planes, scene)
    evidence, which = region_cells(cells, scene)
    # row and column of the label map's pixel in the middle of each cell
    middle = cells.index[which] * REGION.cell_px + REGION.cell_px // 2
    labels = reviewed(labels, evidence, middle, _least_px(labels, options), rng)
    _check_any(labels, options)
    patches = [Patch(k, "region", footprint) for k, footprint in enumerate(region_footprints(labels, scene.shape1), 1)]
    segmentation = Segmentation(gradient, threshold, components, resized(labels, grid.shape))
    return Found(match_regions(labels, cells, patches, scene), segmentation)


def _least_px(labels: Labels, options: Options) -> float:
    """Return the least number of pixels of a region."""
    return options.min_region_percent / 100 * labels.size


def _check_any(labels: Labels, options: Options) -> None:
    """Raise NoAnswer if no pixel is labelled."""
    if not labels.any():
        raise NoAnswer(
            "low-texture",
            f"no plane explains {options.min_region_percent:g} % of image 1",
            "give images with more texture or more overlap, or a smaller --min-region",
        )


def _comparison(scene: Scene, grid: Grid) -> Comparison:
    """Return what compares image 1 on a working grid with image 2 through planes."""
    return Comparison(scene.view(grid), (scene.camera1.focal_px, scene.camera2.focal_px))


def _proposed_planes(scene: Scene, components: Labels, grid: Grid, rng: np.random.Generator) -> list[FloatArray]:
    """Return scaled normals (3,) of planes through neighbouring cells of the overview, and through components."""
    cells, _ = region_cells(scene.cells, scene)
    nearby = neighbourhood_planes(cells, REGION.proposals, rng)
    return [*fewest_planes(cells, nearby), *component_planes(cells, components, grid, nearby)]


def _label_pixels(
    scene: Scene,
    grid: Grid,
    planes: list[FloatArray],
    gradient: FloatImage,
    threshold: float,
    options: Options,
    rng: np.random.Generator,
) -> Labelled:
    """Return the planes left after rounds of fitting, merging and labelling, and the labels of the grid's pixels."""
    comparison = _comparison(scene, grid)
    labels = _initial_labels(scene, planes, gradient, threshold, grid)
    found = Labelled(planes, labels).by_size(REGION.least_sketched * labels.size)
    borders = BorderCost.along_edges(gradient, threshold)
    # each round: step between compared pixels, grid px; least size of a region kept, as a share of the final one
    for step, share in ((2, 0.4), (2, 1.0), (1, 1.0)):
        found = merged(comparison, refitted(comparison, found, rng), options.merge_px, rng)
        boxes = surroundings(found.labels, len(found.planes))
        blocks = label_blocks(comparison, found.planes, borders, REGION.block_px, step, boxes)
        blocks = without_small_pieces(blocks, REGION.least_piece * blocks.size)
        # the pixels of planes dropped here go to other planes in the next round
        labels = enlarged(blocks, REGION.block_px, grid.shape)
        found = Labelled(found.planes, labels).by_size(share * _least_px(labels, options))
    return merged(comparison, found, options.merge_px, rng)


def _initial_labels(
    scene: Scene, planes: list[FloatArray], gradient: FloatImage, threshold: float, working: Grid
) -> Labels:
    """Return first labels (h, w) of the working grid's pixels: k for planes[k - 1].

    They are found on a grid of a quarter of the pixels, as all proposals are compared.
    """
    small = whole_grid(scene, REGION.working_pixels / 4)
    size = (small.shape[1], small.shape[0])
    coarse = np.asarray(cv2.resize(gradient, size, interpolation=cv2.INTER_AREA), np.float32)
    borders = BorderCost.along_edges(coarse, threshold)
    side = REGION.block_px - 1  # px a side of a block: smaller, as a pixel of this grid covers more
    labels = enlarged(label_blocks(_comparison(scene, small), planes, borders, side), side, small.shape)
    return resized(labels, working.shape)
