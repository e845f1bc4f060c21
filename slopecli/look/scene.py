"""Scene: everything known about a pair before planes are found; working grids and views of its windows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.look.dense import Cells
from slopecli.look.features import shrink
from slopecli.look.matches import Evidence
from slopecli.look.photometric import View
from slopecli.look.warp import FloatImage, Grid, Pyramid, covered, cut
from slopecli.types import BoolArray, Camera, FloatArray
from slopecli.windows import Window

if TYPE_CHECKING:
    from slopecli.look.standing_still import Still

FINE_PX = 200  # px a side of the working grid a window is matched on; larger windows are shrunk to it


@dataclass(frozen=True, eq=False)
class Scene:
    """Images, cameras, motion R, T, overview and evidence of a pair.

    find_planes : computes `planes`, which only windows that are hard to match need.
    cells : all of the overview, faint and inconsistent ones included, which `evidence` leaves out.
    still : what stands still in both images, painted over in the pyramids; None if nothing does.
    """

    camera1: Camera
    camera2: Camera
    pyramid1: Pyramid
    pyramid2: Pyramid
    R: FloatArray
    T: FloatArray
    evidence: Evidence
    find_planes: Callable[[], list[FloatArray]]
    cells: Cells
    still: Still | None = None

    @cached_property
    def planes(self) -> list[FloatArray]:
        """Scaled normals (3,) of the scene's dominant planes, largest first."""
        return self.find_planes()

    @property
    def shape1(self) -> tuple[int, int]:
        return self.camera1.height, self.camera1.width

    @property
    def shape2(self) -> tuple[int, int]:
        return self.camera2.height, self.camera2.width

    def rays1(self, uv1: FloatArray) -> FloatArray:
        """Pixels (n, 2) of image 1 as normalised coordinates."""
        return rays_from_pixels(self.camera1, uv1)

    def pixels2(self, x2: FloatArray) -> FloatArray:
        """Normalised coordinates (n, 2) as pixels of image 2."""
        return pixels_from_rays(self.camera2, x2)

    def shown(self, grid: Grid, uv2: FloatImage) -> BoolArray:
        """(h, w) which pixels of a working grid are ground that image 2 shows; uv2 (h, w, 2): its px of them."""
        shown = covered(uv2, self.shape2, 1.0)
        if self.still is None:
            return shown
        y, x = np.indices(grid.shape, np.float32)
        return np.asarray(shown & ~self.still.holds(uv2) & ~self.still.holds(grid.full(np.dstack([x, y]))))

    def view(self, grid: Grid) -> View:
        """`View` of a working grid over image 1 under the motion."""
        return View(grid, self.rays1, self.pixels2, self.R, self.T, self.pyramid2, self.shape2)


def whole_grid(scene: Scene, max_pixels: float) -> Grid:
    """Working grid over all of image 1, shrunk to at most `max_pixels`."""
    grey, scale = shrink(scene.pyramid1.at(1.0).grey, max_pixels)
    return Grid(grey, 0.0, 0.0, scale)


def view_of(window: Window, scene: Scene, side_px: int, border: bool) -> View:
    """`View` of a window on a working grid of about `side_px` px a side, with a border around it if `border`."""
    x, y, w, h = window
    shrink_by = max(w, h) / side_px
    layer = scene.pyramid1.at(shrink_by)
    margin = 8 * max(shrink_by, 1.0) if border else 0.0  # 8 px of the grid: flow is biased at the border of an image
    side = round(side_px * (1 + 2 * margin / max(w, h)))
    return scene.view(cut(layer, x - margin, y - margin, w + 2 * margin, h + 2 * margin, side))


def epipolar_axes(uv1: FloatArray, scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (n, 2) along and across the epipolar lines in image 1; depth displaces a point along its line."""
    rays = homogeneous(rays_from_pixels(scene.camera1, uv1))
    along = rays[:, :2] * scene.T[2] - scene.T[:2]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    return along, np.column_stack([-along[:, 1], along[:, 0]])


def axis_variance(information: FloatArray, uv1: FloatArray, scene: Scene, floor_px: float, noise: float) -> FloatArray:
    """Variance (n, 2), grid px squared, of matches along and across the epipolar line.

    information : (n, 2, 2) structure tensors of their cells, noise units squared per grid px squared.
    uv1 : (n, 2) px of image 1.
    floor_px : 1-sigma of a match of ideal texture, grid px.  noise : 1-sigma of grey values, in the tensors' unit.
    """
    known = [np.einsum("ni,nij,nj->n", axis, information, axis) for axis in epipolar_axes(uv1, scene)]
    return floor_px**2 + noise**2 / np.maximum(np.column_stack(known), 1e-6)
