"""What is known before a window is looked at, and views of image 2 from a window through it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.geometry.epipolar import homogeneous
from slopecli.look.dense import Cells
from slopecli.look.evidence import Evidence
from slopecli.look.features import shrink
from slopecli.look.photometric import View, make_view
from slopecli.look.warp import Grid, Pyramid, cut
from slopecli.types import Camera, FloatArray
from slopecli.windows import Window

FINE_PX = 200  # a window is matched at about this many pixels a side, from shrunken images when it is larger
BORDER_PX = 8  # px of the working grid around a window: flow needs to see past its border


@dataclass(frozen=True, eq=False)
class Scene:
    """What is known before the windows are looked at: images, cameras, the motion, evidence and the scene's planes.

    find_planes : gives the scene's planes, which only difficult windows ask for.
    cells : all of the overview, those of faint texture too, which `evidence` leaves out.
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


def whole_grid(scene: Scene, max_pixels: float) -> Grid:
    """Working grid over all of image 1, averaged down to at most `max_pixels`."""
    grey, scale = shrink(scene.pyramid1.at(1.0).grey, max_pixels)
    return Grid(grey, 0.0, 0.0, scale)


def view_of(window: Window, scene: Scene, side_px: int, border: bool) -> View:
    """A window on a working grid of about `side_px` a side, with some ground around it if `border`, ready to pull
    image 2 onto it."""
    grid = window_grid(window, scene, side_px, border)
    return make_view(grid, scene.rays1, scene.pixels2, scene.R, scene.T, scene.pyramid2, scene.shape2)


def window_grid(window: Window, scene: Scene, side_px: int, border: bool) -> Grid:
    """The working grid of `view_of` alone."""
    x, y, w, h = window
    shrink_by = max(w, h) / side_px
    layer = scene.pyramid1.at(shrink_by)
    margin = BORDER_PX * max(shrink_by, 1.0) if border else 0.0
    side = round(side_px * (1 + 2 * margin / max(w, h)))
    return cut(layer, x - margin, y - margin, w + 2 * margin, h + 2 * margin, side)


def epipolar_axes(uv1: FloatArray, scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Unit vectors (n, 2) along and across the epipolar line in image 1: a change of depth moves content along it."""
    rays = homogeneous(rays_from_pixels(scene.camera1, uv1))
    along = rays[:, :2] * scene.T[2] - scene.T[:2]
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    return along, np.column_stack([-along[:, 1], along[:, 0]])


def axis_variance(information: FloatArray, uv1: FloatArray, scene: Scene, floor_px: float, noise: float) -> FloatArray:
    """Variance (n, 2) of matches along and across the epipolar line, from the structure tensors of their cells.

    Parameters
    ----------
    information : (n, 2, 2) structure tensors, noise units squared per grid px squared.
    uv1 : (n, 2) px of image 1.
    floor_px : 1-sigma that remains with any texture, grid px.  noise : 1-sigma, in the tensors' unit.

    Returns
    -------
    variance : (n, 2) grid px squared.
    """
    known = [np.einsum("ni,nij,nj->n", axis, information, axis) for axis in epipolar_axes(uv1, scene)]
    return floor_px**2 + noise**2 / np.maximum(np.column_stack(known), 1e-6)
