"""The finder `regions`: planes of a scene, each with the pixels of image 1 that lie on it.

Source: Cheng, experiment 3, steps 1-7. Departs from the paper: components of low gradient only propose planes, as do
squares of dense matches, since a textured facade is all gradient and forms no component. Planes grow to pieces, and
pixels are assigned to all planes at once, by their depth and by how well each plane transfers them into image 2.
"""

from __future__ import annotations

from collections.abc import Sized
from dataclasses import dataclass

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.look.dense_depth import depth_cells
from slopecli.look.gradient_components import (
    Labels,
    adaptive_threshold,
    connected_components,
    renumbered_by_size,
    smooth_gradient,
    without_small_pieces,
)
from slopecli.look.scene import Scene, whole_grid
from slopecli.look.scene_from_images import FINE
from slopecli.look.threads import single_threaded
from slopecli.look.transfer_error import Comparison
from slopecli.look.warp import Grid
from slopecli.options import Options
from slopecli.patches.patch import Found, Patch, region_footprints
from slopecli.patches.regions.blank_planes import find_blank_planes
from slopecli.patches.regions.block_labels import BorderCost, enlarged, label_cells
from slopecli.patches.regions.borders import with_pixel_borders
from slopecli.patches.regions.cell_lattice import CellLattice, lattice_of
from slopecli.patches.regions.common_planes import find_common_planes
from slopecli.patches.regions.merging import merged
from slopecli.patches.regions.plane_pieces import KnownTilt, Piece, fewest_pieces, grown_pieces
from slopecli.patches.regions.region_match import match_labelled, match_regions, on_known_orientation
from slopecli.patches.regions.region_tunables import REGION
from slopecli.patches.regions.swept_cells import with_swept_cells
from slopecli.patches.windows.raw_grey import KNOWN
from slopecli.types import Segmentation


@dataclass(frozen=True, eq=False)
class RegionStages:
    """What each stage of the finder made of a scene.

    lattice : cells with their depth.  proposed : pieces grown from proposed planes.  chosen : those that explain the
    cells.  merged : those left after merging.  labels : 1, 2, ... of the pixels (h, w), 0 for none.
    patches : the regions of these labels with their matches.
    """

    lattice: CellLattice
    proposed: list[Piece]
    chosen: list[Piece]
    merged: list[Piece]
    labels: Labels
    patches: list[Patch]
    segmentation: Segmentation


def find_regions(scene: Scene, options: Options) -> Found:
    """Return the planes of a scene, largest first, each with its footprint and its matches.

    Raises
    ------
    NoAnswer : no plane has `min_region_percent` of the pixels of image 1.
    """
    stages = region_stages(scene, options)
    return Found(stages.patches, stages.segmentation)


def region_stages(scene: Scene, options: Options) -> RegionStages:
    """Return the stages of the finder; see `find_regions`."""
    grid = whole_grid(scene, FINE.max_pixels)
    # steps 1-3: gradient, threshold, components
    gradient = smooth_gradient(grid.grey)
    threshold = options.gradient_threshold or adaptive_threshold(gradient)
    components = connected_components(gradient, threshold, REGION.least_share * gradient.size)
    # steps 4-7: planes of components and of neighbouring matches proposed and grown, merged where one fits two
    with single_threaded():
        lattice = _lattice(components, scene, grid)
        proposed = grown_pieces(lattice, components)
        chosen = fewest_pieces(lattice, proposed)
        common = find_common_planes(lattice, components, chosen)
        pieces = merged(lattice, [*chosen, *(plane.piece for plane in common)], options.merge_px)
        borders = BorderCost.along_edges(gradient, threshold)
        comparison = Comparison(scene.view(grid), (scene.camera1.focal_px, scene.camera2.focal_px))
        cells, apart = _label_cells(comparison, lattice, pieces, borders, components)
        common = _filled(cells, pieces, common)
        least = options.min_region_percent / 100 * gradient.size
        blank = find_blank_planes(cells, components, pieces, lattice, scene.view(grid), scene, least)
        for number, plane in enumerate(blank, len(pieces) + 1):
            cells[plane.piece.cells] = number
        apart *= cells == 0
        cells += apart
        labels, kept = _label_pixels(cells, comparison, [*pieces, *(plane.piece for plane in blank)], options)
        matches = match_labelled(labels, [piece.plane for piece in kept], scene)
        matches = matches.take(apart[tuple(matches.index.T)] == 0)
    patches = [Patch(k, "region", footprint) for k, footprint in enumerate(region_footprints(labels, scene.shape1), 1)]
    patches = _with_known(match_regions(labels, matches, patches, scene), kept, [*common, *blank], scene)
    account = _account(lattice, (proposed, chosen, common, pieces, blank, kept), cells, options)
    segmentation = Segmentation(gradient, threshold, components, labels, account)
    return RegionStages(lattice, proposed, chosen, pieces, labels, patches, segmentation)


def _lattice(components: Labels, scene: Scene, grid: Grid) -> CellLattice:
    """Return the cells of the working grid, those that a sweep of planes finds among them; components (h, w)."""
    cells = depth_cells(scene, grid, REGION.cell_px)
    lattice = lattice_of(cells, grid.shape, scene)
    swept = with_swept_cells(cells, lattice, components, scene, grid)
    return lattice if swept is cells else lattice_of(swept, grid.shape, scene)


def _account(lattice: CellLattice, stages: tuple[Sized, ...], cells: Labels, options: Options) -> tuple[str, ...]:
    """Return sentences on what was proposed, labelled and given up, and why.

    stages : pieces proposed, chosen, common to components, merged, of blank components, and kept.  cells : the labels
    by number of the merged piece, then of the blank component.
    """
    proposed, chosen, common, merging, blank, kept = (len(pieces) for pieces in stages)
    held = np.count_nonzero(np.bincount(cells.ravel(), minlength=merging + blank + 1)[1:])
    return (
        f"{100 * lattice.known.mean():.0f} % of the cells of image 1 have a match, 1-sigma {lattice.sigma_px:.2f} px; "
        f"{lattice.sharing:.0f} cells share an error",
        f"{proposed} planes proposed, {chosen} explain the matches, {common} are common to several components, "
        f"{merging} after merging, {blank} more of blank surfaces have an orientation known elsewhere, {kept} labelled",
        f"given up: {proposed - chosen} planes save too little beside the others, {chosen + common - merging} are one "
        f"with another, {merging + blank - held} hold no pixel, {held - kept} less than "
        f"{options.min_region_percent:g} % of image 1",
    )


def _filled(cells: Labels, pieces: list[Piece], common: list[KnownTilt]) -> list[KnownTilt]:
    """Label the cells (h, w) of common planes that are on no plane; return the pieces that these planes are part of."""
    found = list[KnownTilt]()
    for plane in common:
        own = plane.piece.cells
        number = max(range(len(pieces)), key=lambda k: np.count_nonzero(pieces[k].cells & own))
        cells[own & (cells == 0)] = number + 1
        found.append(KnownTilt(pieces[number], plane.sigma_rad))
    return found


def _with_known(patches: list[Patch], kept: list[Piece], known: list[KnownTilt], scene: Scene) -> list[Patch]:
    """Return the regions, of pieces (k) kept, on the planes of these where known and their matches leave them open."""
    sigma = {id(plane.piece): plane.sigma_rad for plane in known}
    return [
        on_known_orientation(patch, piece.plane, sigma[id(piece)], scene)
        if id(piece) in sigma and (patch.origin == "none" or patch.tilt_sigma_rad > KNOWN.parallel_rad)
        else patch
        for patch, piece in zip(patches, kept, strict=True)
    ]


def _label_cells(
    comparison: Comparison, lattice: CellLattice, pieces: list[Piece], borders: BorderCost, components: Labels
) -> tuple[Labels, Labels]:
    """Return the label (h, w) of every cell, 1..k by piece, 0 for none; and of cells apart from the matched ones."""
    if not pieces:
        return np.zeros(lattice.shape, np.int32), np.zeros(lattice.shape, np.int32)
    cells, apart = label_cells(comparison, lattice, pieces, borders, components)
    return without_small_pieces(cells, REGION.least_piece * cells.size), apart


def _label_pixels(
    cells: Labels, comparison: Comparison, pieces: list[Piece], options: Options
) -> tuple[Labels, list[Piece]]:
    """Return the labels (h, w) of the grid's pixels, largest first from 1, and the piece of each."""
    labels = with_pixel_borders(
        enlarged(cells, REGION.cell_px, comparison.shape), comparison.grid.grey, comparison, pieces
    )
    labels, order = renumbered_by_size(labels, options.min_region_percent / 100 * labels.size)
    if not labels.any():
        raise NoAnswer(
            "low-texture",
            f"no plane explains {options.min_region_percent:g} % of image 1",
            "give images with more texture or more overlap, or a smaller --min-region",
        )
    return labels, [pieces[k - 1] for k in order]
