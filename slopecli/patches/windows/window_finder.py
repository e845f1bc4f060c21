"""The windows finder: rectangles given by the user, or those of a grid, each matched by itself."""

from __future__ import annotations

from collections.abc import Callable

from slopecli.look.scene import Scene
from slopecli.look.threads import single_threaded
from slopecli.options import Options
from slopecli.patches.patch import Found, Patch, window_footprint
from slopecli.patches.windows.corners import match_window_corners
from slopecli.patches.windows.matching import match_window
from slopecli.windows import Window, check_windows, grid_windows

# what `--features` names: the matcher of a window
WINDOW_MATCHERS: dict[str, Callable[[Patch, Scene], Patch]] = {
    "sift": match_window,
    "foerstner": match_window_corners,
}


def find_in_windows(scene: Scene, options: Options) -> Found:
    """One patch per window, each matched by itself, guided by the scene.

    Raises
    ------
    InputError : a window is not inside image 1.
    """
    windows = wanted_windows(options, scene.camera1.width, scene.camera1.height)
    match = WINDOW_MATCHERS[options.features]
    with single_threaded():
        return Found([match(window_patch(window, k), scene) for k, window in enumerate(windows, 1)])


def window_patch(window: Window, number: int = 1) -> Patch:
    """The patch of a window, still without matches; `number`: its id."""
    return Patch(number, "window", window_footprint(window))


def wanted_windows(options: Options, width: int, height: int) -> list[Window]:
    """The windows given, or those of the grid, checked against image 1 (px).

    Raises
    ------
    InputError : a window is too small or not inside image 1.
    """
    windows = list(options.windows) or grid_windows(*options.grid, width, height)
    check_windows(windows, width, height)
    return windows
