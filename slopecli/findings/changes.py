"""What changed in the scene between the images: ground that brightened or darkened, and things that moved.

Noise, mismatches and occlusions are small or scattered; a shadow or a vehicle is one connected area. Both are looked
for in cells over all of image 1, and areas below `LEAST_AREA` are left to the robust solution.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from slopecli.geometry.motion import epipolar_residual, inverse_depth
from slopecli.geometry.statistics import median
from slopecli.look.matches import pair_rays, thin
from slopecli.look.noise import NOISE_GREY
from slopecli.look.overview import CELL, sparse_transfer
from slopecli.look.photometric import detrend
from slopecli.look.scene import Scene
from slopecli.look.scene_from_images import MIN_INFORMATION
from slopecli.look.warp import FloatImage, Grid, covered, cut, resample, transfer_map
from slopecli.types import BoolArray, FloatArray

LEAST_AREA = 0.01  # of image 1: what is not one plane, or mirrors light, makes areas of up to 0.7 %
# ground that changed brightness
WORKING_PX, BLOCK = 1.0e5, 6  # pixels image 1 is averaged down to, and px of a cell of them
LEADING = 2000  # matches that tell where image 2 shows the ground: a smooth map needs no more
TEXTURE_PX = 3.0  # working px over which brightness is taken for shading, not texture
SAME_GROUND = 0.6  # correlation of the texture of a cell from which on both images show the same ground
WHOLLY_SEEN = 0.99  # share of a cell that image 2 must show
DARKER, DARKER_SIGMAS = 0.25, 4.0  # change of log brightness that counts, and in sigmas; a shadow's is 0.4 and more
SCATTER = (0.03, 0.1)  # 1-sigma of the log brightness of unchanged ground, between these
FIT_ROUNDS, GATE_SIGMAS = 10, 2.5
# things that moved
DEFYING_PX = 3.0  # a match this far off its epipolar line, or behind the camera by this, is of something that moved
SAME_THING = 0.5  # photometric correlation of a match that is no mismatch


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
    """Areas of image 1 that contradict the rest of the scene, with their cells; empty where nothing changed."""
    found = [_brightness(scene), _motion(scene)]
    return [change for change in found if len(change.uv1)]


def _connected(mask: BoolArray) -> BoolArray:
    """The cells (rows, columns) of a mask that lie in an area large enough, neighbours at corners counted."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    large = stats[:, cv2.CC_STAT_AREA] >= LEAST_AREA * mask.size
    large[0] = False
    return np.asarray(large[labels])


# ---- ground that brightened or darkened ----


def _brightness(scene: Scene) -> Change:
    """Ground with the same texture in both images, brighter or darker by more than exposure and lens make it."""
    grid, theirs, seen = _laid_over(scene)
    rows, columns = grid.shape[0] // BLOCK, grid.shape[1] // BLOCK

    def mean(layer: FloatImage) -> FloatImage:
        whole = np.ascontiguousarray(layer[: rows * BLOCK, : columns * BLOCK])
        return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), np.float32)

    ours = grid.grey.astype(np.float32)
    a, b = detrend(ours, TEXTURE_PX), detrend(theirs, TEXTURE_PX)
    alike = mean(a * b) > SAME_GROUND * np.sqrt(mean(a * a) * mean(b * b) + 1e-6)
    known = mean(seen.astype(np.float32)) > WHOLLY_SEEN
    change = _log_change(mean(ours), mean(theirs), known)
    cells = np.argwhere(_connected(alike & (change > 1.0)) | _connected(alike & (change < -1.0)))
    centres = (cells[:, ::-1].astype(float) + 0.5) * BLOCK - 0.5
    return Change("brightness", grid.full(centres), 1.0 / (rows * columns))


def _laid_over(scene: Scene) -> tuple[Grid, FloatImage, BoolArray]:
    """Image 1 averaged down, image 2 laid over it by a smooth map through the matches, and where it shows anything."""
    height, width = scene.shape1
    shrink_by = max(1.0, float(np.sqrt(height * width / WORKING_PX)))
    grid = cut(scene.pyramid1.at(shrink_by), 0, 0, width, height, round(max(height, width) / shrink_by))
    matches, scale = scene.evidence, scene.pyramid1.overview_scale
    some = thin(matches.uv1, np.arange(len(matches)), LEADING)
    shape = (round(height * float(scale[1])), round(width * float(scale[0])))
    mapping = transfer_map(grid, sparse_transfer(matches.uv1[some], scene.pixels2(matches.x2[some]), scale, shape))
    return grid, resample(scene.pyramid2, mapping, grid), covered(mapping, scene.shape2)


def _log_change(ours: FloatImage, theirs: FloatImage, known: BoolArray) -> FloatArray:
    """Change of log brightness (rows, columns) over what counts as one, exposure and the lens's falloff taken out.

    Taken out is a robust fit of a constant, a slope along rows and columns, and one with brightness.
    known : the cells that both images show; elsewhere the change is 0.
    """
    change = np.zeros(known.shape)
    if known.sum() < FIT_ROUNDS:
        return change
    log1, log2 = np.log(np.maximum(ours, 2 * NOISE_GREY)), np.log(np.maximum(theirs, 2 * NOISE_GREY))
    v, u = np.indices(known.shape) / np.reshape(known.shape, (2, 1, 1)) - 0.5
    design = np.stack([np.ones(known.shape), u, v, log1 - median(log1)], -1)[known]
    target = (log2 - log1)[known].astype(float)
    left, sigma = target - median(target), SCATTER[1]
    for _ in range(FIT_ROUNDS):
        sigma = float(np.clip(1.4826 * median(np.abs(left)), *SCATTER))
        weighted = design / (1 + (left / (GATE_SIGMAS * sigma)) ** 2)[:, None] ** 2
        left = target - design @ np.linalg.solve(weighted.T @ design + 1e-6 * np.eye(4), weighted.T @ target)
    change[known] = left / max(DARKER, DARKER_SIGMAS * sigma)
    return change


# ---- things that moved ----


def _motion(scene: Scene) -> Change:
    """Cells that match image 2 well, but not where the camera's motion could have put them."""
    cells, focal_px = scene.cells, scene.camera2.focal_px
    x1, x2, imaged = pair_rays(scene.camera1, scene.camera2, cells.uv1, cells.uv2)
    w, leverage = inverse_depth(scene.R, scene.T, x1, x2)
    off = np.abs(epipolar_residual(scene.R, scene.T, x1, x2)) * focal_px > DEFYING_PX
    behind = w * leverage * focal_px < -DEFYING_PX
    sharp = np.linalg.eigvalsh(cells.information)[:, 0] > MIN_INFORMATION
    defying = imaged & (off | behind) & sharp & (cells.agreement > SAME_THING)
    size = np.array(scene.shape1) * scene.pyramid1.overview_scale[::-1]
    mask = np.zeros((size / CELL).astype(int) + 1, bool)
    mask[tuple(cells.index[defying].T)] = True
    chosen = defying & _connected(mask)[tuple(cells.index.T)]
    return Change("motion", cells.uv1[chosen], CELL**2 / float(size.prod()))
