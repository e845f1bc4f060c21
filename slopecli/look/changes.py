"""Dense matches of a scene that contradict it: areas that changed between the images, and the camera file's lens model.

Areas change where ground became brighter or darker, and where things moved.
Noise, mismatches and occlusions are small or scattered; a shadow or a vehicle is one connected area. Both are searched
for in cells over all of image 1; the robust solution copes with areas below `LEAST_AREA`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from slopecli.geometry.motion import LensMisfit, epipolar_residual, find_lens_misfit, inverse_depth
from slopecli.geometry.statistics import median, robust_least_squares
from slopecli.look.dense import CELL, sparse_transfer
from slopecli.look.matches import pair_rays, thin
from slopecli.look.noise import NOISE_GREY, SAME_GROUND, SYSTEMATIC_PX
from slopecli.look.photometric import detrend
from slopecli.look.scene import Scene
from slopecli.look.warp import FloatImage, Grid, covered, cut, resample, transfer_map
from slopecli.types import BoolArray, FloatArray

LEAST_AREA = 0.01  # of image 1: relief and specular reflections make areas of up to 0.7 %
BLOCK_PX = 6  # px of a cell, of image 1 averaged down to 1e5 px
DARKER = 0.25  # change of log brightness that counts, if it is 4 sigmas as well; a shadow's is 0.4 and more
CONTRADICTING_PX = 3.0  # off its epipolar line, or behind the camera: a match of something that moved


@dataclass(frozen=True, eq=False)
class Change:
    """Centres uv1 (n, 2) of the cells that changed, px of image 1; each is `cell_share` of the image's area."""

    kind: Literal["brightness", "motion"]
    uv1: FloatArray
    cell_share: float

    @property
    def share(self) -> float:
        """Of image 1."""
        return len(self.uv1) * self.cell_share


def find_changes(scene: Scene) -> list[Change]:
    """Areas of image 1 that contradict the rest of the scene; empty where nothing changed."""
    found = [_brightness(scene), _motion(scene)]
    return [change for change in found if len(change.uv1)]


def _connected(mask: BoolArray) -> BoolArray:
    """The cells (rows, columns) of a mask in 8-connected areas of at least `LEAST_AREA`."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] >= LEAST_AREA * mask.size
    large[0] = False
    return np.asarray(large[labels])


# ---- ground that became brighter or darker ----


def _brightness(scene: Scene) -> Change:
    """Ground with the same texture in both images whose brightness changed by more than exposure and lens explain."""
    grid, laid_over, seen = _image2_on_image1(scene)
    rows, columns = grid.shape[0] // BLOCK_PX, grid.shape[1] // BLOCK_PX

    def mean(layer: FloatImage) -> FloatImage:
        whole = np.ascontiguousarray(layer[: rows * BLOCK_PX, : columns * BLOCK_PX])
        return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)

    grey1 = grid.grey.astype(np.float32)
    a, b = detrend(grey1, 3.0), detrend(laid_over, 3.0)  # texture, without shading over more than 3 px
    alike = mean(a * b) > SAME_GROUND * np.sqrt(mean(a * a) * mean(b * b) + 1e-6)
    change = _log_change(mean(grey1), mean(laid_over), mean(seen.astype(np.float32)) > 0.99)
    cells = np.argwhere(_connected(alike & (change > 1.0)) | _connected(alike & (change < -1.0)))
    centres = (cells[:, ::-1].astype(float) + 0.5) * BLOCK_PX - 0.5
    return Change("brightness", grid.full(centres), 1.0 / (rows * columns))


def _image2_on_image1(scene: Scene) -> tuple[Grid, FloatImage, BoolArray]:
    """Image 1 averaged down to 1e5 px, image 2 resampled to it by a smooth map through the matches, and where it is."""
    height, width = scene.shape1
    shrink_by = max(1.0, float(np.sqrt(height * width / 1e5)))
    grid = cut(scene.pyramid1.at(shrink_by), 0, 0, width, height, round(max(height, width) / shrink_by))
    matches, scale = scene.evidence, scene.pyramid1.overview_scale
    some = thin(matches.uv1, np.arange(len(matches)), 2000)
    shape = (round(height * float(scale[1])), round(width * float(scale[0])))
    mapping = transfer_map(grid, sparse_transfer(matches.uv1[some], scene.pixels2(matches.x2[some]), scale, shape))
    return grid, resample(scene.pyramid2, mapping, grid), covered(mapping, scene.shape2)


def _log_change(mean1: FloatImage, mean2: FloatImage, known: BoolArray) -> FloatArray:
    """Change of log brightness (rows, columns) over what counts as one, 0 where not `known`.

    Exposure and falloff of the lens are removed: a robust fit of a constant, a slope along rows and columns, and one
    with brightness.
    """
    change = np.zeros(known.shape)
    if known.sum() < 10:
        return change
    log1, log2 = (np.log(np.maximum(mean, 2 * NOISE_GREY)) for mean in (mean1, mean2))
    v, u = np.indices(known.shape) / np.reshape(known.shape, (2, 1, 1)) - 0.5
    design = np.stack([np.ones(known.shape), u, v, log1 - median(log1)], -1)[known]
    target = (log2 - log1)[known].astype(float)
    start = np.array([median(target), 0.0, 0.0, 0.0])
    fitted, sigma = robust_least_squares(design, target, start, (0.03, 0.1), rounds=10)  # sigma of unchanged ground
    change[known] = (target - design @ fitted) / np.maximum(DARKER, 4.0 * sigma)
    return change


# ---- things that moved ----


def _motion(scene: Scene) -> Change:
    """Cells that match image 2 well (correlation above 0.5), but not where the camera's motion could have put them."""
    cells, focal_px = scene.cells, scene.camera2.focal_px
    x1, x2, imaged = pair_rays(scene.camera1, scene.camera2, cells.uv1, cells.uv2)
    w, leverage = inverse_depth(scene.R, scene.T, x1, x2)
    off = np.abs(epipolar_residual(scene.R, scene.T, x1, x2)) * focal_px > CONTRADICTING_PX
    behind = w * leverage * focal_px < -CONTRADICTING_PX
    contradicting = imaged & (off | behind) & cells.textured & (cells.agreement > 0.5)
    size = np.array(scene.shape1) * cells.pixel_scale
    mask = np.zeros((size / CELL).astype(int) + 1, bool)
    mask[tuple(cells.index[contradicting].T)] = True
    chosen = contradicting & _connected(mask)[tuple(cells.index.T)]
    return Change("motion", cells.uv1[chosen], CELL**2 / float(size.prod()))


# ---- lens model ----


def lens_misfit(scene: Scene) -> LensMisfit | None:
    """The radial term by which the lens clearly differs from the camera file, or None.

    Uses at most 1200 matches of the overview, mismatches included, spread over the image.
    """
    cells, focal_px = scene.cells, scene.camera2.focal_px
    some = thin(cells.uv1, np.flatnonzero(cells.textured), 1200)
    x1, x2, imaged = pair_rays(scene.camera1, scene.camera2, cells.uv1[some], cells.uv2[some])
    # one radial term does not model a lens further off its axis
    near = imaged & (np.linalg.norm(x1, axis=1) < 1.5) & (np.linalg.norm(x2, axis=1) < 1.5)
    return find_lens_misfit(scene.R, scene.T, x1[near], x2[near], SYSTEMATIC_PX / focal_px)
