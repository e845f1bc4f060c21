"""Test of the lens model of a camera file against the dense matches of a scene."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.motion import LensMisfit, find_lens_misfit
from slopecli.look.matches import pair_rays, thin
from slopecli.look.noise import SYSTEMATIC_PX
from slopecli.look.scene import Scene
from slopecli.look.scene_from_images import MIN_INFORMATION


def lens_misfit(scene: Scene) -> LensMisfit | None:
    """The radial term by which the lens clearly differs from the camera file, or None.

    Uses at most 1200 matches of the overview, mismatches included, spread over the image.
    """
    cells, focal_px = scene.cells, scene.camera2.focal_px
    textured = np.flatnonzero(np.linalg.eigvalsh(cells.information)[:, 0] > MIN_INFORMATION)
    some = thin(cells.uv1, textured, 1200)
    x1, x2, imaged = pair_rays(scene.camera1, scene.camera2, cells.uv1[some], cells.uv2[some])
    # one radial term does not model a lens further off its axis
    near = imaged & (np.linalg.norm(x1, axis=1) < 1.5) & (np.linalg.norm(x2, axis=1) < 1.5)
    return find_lens_misfit(scene.R, scene.T, x1[near], x2[near], SYSTEMATIC_PX / focal_px)
