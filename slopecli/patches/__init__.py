"""Finders of planes: which correspondences are held coplanar. One row of `FINDERS` a finder. Light to import."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from slopecli.face import lazy_names

if TYPE_CHECKING:
    from slopecli.look.scene import Scene
    from slopecli.options import Options
    from slopecli.patches.patch import Found

    PlaneFinder = Callable[[Scene, Options], Found]


class Finder(NamedTuple):
    """One way to come by patches.

    Attributes
    ----------
    choice : the value of `--planes` that names it, "" for what is not chosen by that option.
    source : how its planes are marked in slopes.json.  noun : what messages call one of them.
    function : "module:function" of this package, see `find`; imported when it is called.
    options : names of those `Options` (and of command-line flags) that say something to this finder.
    flatter : what to do about a patch that is not planar.
    found : whether it finds patches in the image, of any shape, rather than being told where they are.
    """

    choice: str
    source: str
    noun: str
    function: str
    options: tuple[str, ...]
    flatter: str
    found: bool

    def find(self, scene: Scene, options: Options) -> Found:
        """The patches of a scene, each with its own matches or the reason why it has none.

        InputError if the options ask for patches that cannot be; NoAnswer if there is no patch.
        """
        module, function = self.function.split(":")
        found: Found = getattr(import_module(f"{__name__}.{module}"), function)(scene, options)
        return found


_FLATTER = "look at it with slopemap estimate --window, or lower --merge-px"
FINDERS = (
    Finder(
        choice="windows",
        source="window",
        noun="window",
        function="windows.window_finder:find_in_windows",
        options=("grid", "windows"),
        flatter="use smaller windows",
        found=False,
    ),
    Finder(
        choice="ransac",
        source="ransac",
        noun="plane",
        function="labelling.feature_planes:find_feature_planes",
        options=("min_region_percent", "every"),
        flatter=_FLATTER,
        found=True,
    ),
    Finder(
        choice="regions",
        source="region",
        noun="region",
        function="regions.region_finder:find_regions",
        options=("min_region_percent", "gradient_threshold", "merge_px", "debug_images", "every"),
        flatter=_FLATTER,
        found=True,
    ),
    Finder(  # a user's own correspondences, which `pipeline.solve` joins without a scene
        choice="",
        source="given",
        noun="plane",
        function="",
        options=(),
        flatter="leave out rows that lie off it, give them another patch, or have planes found by --planes found",
        found=False,
    ),
)
FINDER_OF = {finder.source: finder for finder in FINDERS}
PLANE_FINDERS: dict[str, PlaneFinder] = {finder.choice: finder.find for finder in FINDERS if finder.choice}


__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "uncalibrated": "label_planes",
        "given": "Given",
        "join": "Joined MergedGroup join_patches merge_patches",
        "row_planes": "rows_by_label_image rows_by_label_planes rows_in_windows rows_on_one_plane",
        "patch": "Footprint Found Patch overdispersion paint_labels region_footprints window_footprint",
    },
)
