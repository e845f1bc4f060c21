"""Parameters of the finder `regions`, each with its unit and the reason for its value.

"Working px" are px of image 1 averaged down to `working_pixels`; costs are squared errors over their variances.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RegionTunables:
    """Parameters in the order in which the procedure needs them."""

    # sizes of images and of the smallest pieces
    working_pixels: float = 5.0e5  # of image 1 that are labelled; borders of planes are as exact as that
    matched_pixels: float = 6.0e5  # of it on which regions are matched
    least_share: float = 5e-4  # of the image: smaller components propose no plane
    least_sketched: float = 1e-3  # share of the image: smaller planes are dropped before the first fit
    least_piece: float = 3e-4  # share of the image: smaller pieces of a plane are dropped
    block_px: int = 4  # working px a side of the blocks that are labelled as one
    # dense cells
    cell_floor_px: float = 0.08  # 1-sigma of a cell with any texture, px of its grid
    most_sigma_px: float = 1.0  # along the epipolar line: cells known worse do not help to find a plane
    epipolar_px: tuple[float, float] = (1.0, 2.0)  # least and most a cell may be off its epipolar line, else 3 sigma
    # proposals
    proposals: int = 600  # neighbourhoods of cells that propose a plane
    neighbourhoods: tuple[int, ...] = (6, 12, 24)  # cells in them: few for small planes, many against noise
    truncated: float = 9.0  # cost of a cell on another plane, however far off it is
    cell_unexplained: float = 7.0  # cost of a cell that no plane explains
    cell_gain: float = 25.0  # a proposal must explain this much more: three or four cells
    most_planes: int = 70  # from neighbourhoods: the most an image of a million pixels shows
    rim_px: float = 4.0  # working px around a component whose cells belong to it: its border carries the texture
    # labels
    unexplained: float = 3.5  # cost of a pixel on no plane: a plane explains it if it is off by less than 1.9 sigma
    border: float = 3.0  # cost per px of a border between two planes amid a surface
    border_at_edge: float = 0.1  # share of that where the image has a strong edge
    beside_px: int = 48  # working px around the pixels of a plane in which it may win more
    # fits and mergers
    fit_pixels: int = 1500  # of a region that its plane is fitted to
    test_pixels: int = 400  # of a region on which two planes compete
    least_pixels: int = 100  # with fewer a plane is not fitted again
    saved: float = 600.0  # cost a plane must save to stay apart: neighbouring pixels share their errors
    saved_per_px: float = 0.12  # and per pixel: what lens and interpolation leave between two fits of one plane
    # matches of regions
    cell_px: int = 6  # px of the matched grid a side of a cell: several fit in a region of a thousandth of the image
    reach_px: float = 16.0  # px of that grid by which flow sees past a region's border
    least_width: float = 1e-2  # smallest over largest spread of a region's matches: a line leaves the tilt open
    scarce_share: float = 0.3  # matched share of a region below which ...
    faint_score: float = 0.7  # ... and correlation below which its matches leave the tilt open
    repeated_px: float = 0.03  # 1-sigma, px of image 2, by which flow on faint texture stays where it started
    # regions split where their matches lie on several planes
    split_cells: int = 400  # of a region that decide whether it is two planes
    split_proposals: int = 60  # places where neighbourhoods of them propose a plane
    split_neighbourhoods: tuple[int, ...] = (8, 16)  # cells in them: a narrow part has few
    fewest_cells: int = 14  # that make a plane of their own
    split_gain: float = 60.0  # cost two planes must save over one: neighbouring cells share their errors
    piece_gain: float = 40.0  # the same for a piece apart from the rest, whose border is known
    split_ratio: float = 1.3  # by which the cost must fall, too: relief is no edge between two planes
    split_truncated: float = 25.0  # cost of a cell on another plane, however far off it is
    split_deg: float = 6.0  # least angle between planes worth splitting: steps in a facade face one way
    gap: float = 0.08  # of the image's longer side: wider gaps between a region's matches are not part of it
    remote: float = 3.0  # distance of two pieces, in widths of the larger one, beyond which they are not one plane
    rim_cells: int = 4  # cells around its matches that a region keeps: flow is not measured up to its border


REGION = RegionTunables()
