"""Which correspondences are held coplanar: one module per finder of planes, and one dict that names them.

Each finder is loaded when it is first asked for: none needs the others, and together they take as long to import as a
pair of small images to solve.
"""

from __future__ import annotations

from collections.abc import Callable

from slopecli.face import lazy_names
from slopecli.look.scene import Scene
from slopecli.options import Options
from slopecli.patches.patch import Found

PlaneFinder = Callable[[Scene, Options], Found]


def _windows(scene: Scene, options: Options) -> Found:
    from slopecli.patches.windows.window_finder import find_in_windows

    return find_in_windows(scene, options)


def _feature_planes(scene: Scene, options: Options) -> Found:
    from slopecli.patches.labelling.feature_planes import find_feature_planes

    return find_feature_planes(scene, options)


def _regions(scene: Scene, options: Options) -> Found:
    from slopecli.patches.regions.region_finder import find_regions

    return find_regions(scene, options)


# what `--planes` names
PLANE_FINDERS: dict[str, PlaneFinder] = {"windows": _windows, "ransac": _feature_planes, "regions": _regions}


__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "uncalibrated": "label_planes",
        "footprint": "Footprint paint_labels region_footprints window_footprint",
        "join": "Joined join_patches",
        "merge_coplanar": "MergedGroup merge_patches",
        "patch": "Found Patch overdispersion",
    },
)
