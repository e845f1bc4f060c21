"""Parameters of the finder `regions`, each with its unit and the reason for its value.

"Working px" are px of image 1 averaged down to `working_pixels`; costs are squared errors over their variances, that is
twice the negative logarithm of a likelihood.
"""

from __future__ import annotations

from typing import NamedTuple


class RegionTunables(NamedTuple):
    """Parameters in the order in which the procedure needs them."""

    # sizes of images and of the smallest pieces
    least_share: float = 5e-4  # of the image: smaller components propose no plane
    least_piece: float = 3e-4  # share of the image: smaller pieces of a plane are dropped
    # cells
    cell_px: int = 6  # working px a side: several fit in a region of a thousandth of the image
    least_noise_px: float = 0.04  # 1-sigma of a cell of ideal texture, working px: less is not believed of flow
    swept_share: float = 0.01  # of the image, in one piece without a match: less is not looked for at other depths
    # planes proposed, and the pieces grown from them
    windows: tuple[int, ...] = (3, 5, 9, 17, 33)  # cells a side of the squares that propose a plane
    tolerances: tuple[float, ...] = (1.0, 2.5, 5.0)  # in sigmas: a surface with relief is off its plane by more
    near_cells: int = 5  # side of the square in which ...
    compact: float = 0.6  # ... this share of cells must lie on a plane that holds the one in the middle
    most_pieces: int = 150  # more than an image of half a megapixel shows
    # pieces merged
    alike: float = 0.1  # cost per cell that a common plane may add besides: what lens and flow leave of one plane
    relief: float = 0.08  # offset of two parallel surfaces side by side, in widths of the smaller, that is relief
    parallel_deg: float = 6.0  # largest angle between these
    # labels
    unexplained: float = 3.5  # photometric cost of a pixel on no plane: a plane explains it within 1.9 sigma
    pixels: float = 4.0  # independent pixels of a cell: neighbouring pixels share their errors
    border: float = 0.7  # cost per px of a border between two planes amid a surface
    border_at_edge: float = 0.1  # share of that where the image has a strong edge
    beside_cells: int = 8  # around the cells of a plane in which it may win more
    dense_cells: int = 7  # matched cells of a plane in that square without which one is chance
    inside_cells: int = 4  # around matched cells inside a component, that are part of the plane, too ...
    held: float = 0.3  # of which these matched cells are such a share
    # matches of regions
    reach_px: float = 16.0  # working px by which flow sees past a region's border
    least_width: float = 1e-2  # smallest over largest spread of a region's matches: a line leaves the tilt open
    faint_score: float = 0.7  # of the few matches of a region, correlation below which they leave the tilt open


REGION = RegionTunables()
