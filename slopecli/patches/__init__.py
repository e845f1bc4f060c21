"""Which correspondences are held coplanar: one module per finder of planes, and one dict that names them.

Each finder is loaded when it is first asked for: none needs the others, and together they take as long to import as a
pair of small images to solve.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from slopecli.look.scene import Scene
from slopecli.options import Options
from slopecli.patches.patch_set import Patches

if TYPE_CHECKING:
    from slopecli.patches.labelling.label_planes import label_planes

__all__ = ["PLANE_FINDERS", "label_planes"]

PlaneFinder = Callable[[Scene, Options], Patches]


def _windows(scene: Scene, options: Options) -> Patches:
    from slopecli.patches.windows.window_finder import find_in_windows

    return find_in_windows(scene, options)


def _feature_planes(scene: Scene, options: Options) -> Patches:
    from slopecli.patches.labelling.feature_planes import find_feature_planes

    return find_feature_planes(scene, options)


def _regions(scene: Scene, options: Options) -> Patches:
    from slopecli.patches.regions.region_finder import find_regions

    return find_regions(scene, options)


# what `--planes` names
PLANE_FINDERS: dict[str, PlaneFinder] = {"windows": _windows, "ransac": _feature_planes, "regions": _regions}


def __getattr__(name: str) -> Any:
    if name == "label_planes":
        from slopecli.patches.labelling.label_planes import label_planes

        return label_planes
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
