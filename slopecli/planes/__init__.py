"""Which correspondences are held coplanar: one module per finder of planes, and one dict that names them."""

from __future__ import annotations

from collections.abc import Callable

from slopecli.options import Options
from slopecli.planes.feature_planes import find_feature_planes
from slopecli.planes.patches import Patches
from slopecli.planes.ransac import label_planes
from slopecli.planes.regions import find_regions
from slopecli.planes.scene import Scene
from slopecli.planes.window_finder import find_in_windows

__all__ = ["PLANE_FINDERS", "label_planes"]

PlaneFinder = Callable[[Scene, Options], Patches]

# what `--planes` names
PLANE_FINDERS: dict[str, PlaneFinder] = {
    "windows": find_in_windows,
    "ransac": find_feature_planes,
    "regions": find_regions,
}
