"""When the quick pass is tried, and when its result is used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from slopecli import load_camera, load_image
from slopecli.geometry import MotionEstimate, assess_motion
from slopecli.look import COARSE, FINE, Matches, Sparse, find_scene, is_decided, may_suffice, overview_effort
from slopecli.options import Options
from slopecli.windows import Window, grid_windows

PAIR = Path(__file__).parent.parent / "sample_data" / "descent"
GREY = np.zeros((1000, 1000), np.uint8)
R, T = np.eye(3), np.array([0.3, 0.1, 1.0]) / np.linalg.norm([0.3, 0.1, 1.0])


def sparse(n: int, wrong: int, roots: int = 1) -> Sparse:
    """Matches of a motion, some of them mismatches, and motions that fit them alike."""
    rng = np.random.default_rng(5)
    x1, depth = rng.uniform(-0.5, 0.5, (n, 2)), rng.uniform(5.0, 8.0, (n, 1))
    moved = np.hstack([x1 * depth, depth]) - T
    x2 = moved[:, :2] / moved[:, 2:]
    x2[:wrong] = rng.uniform(-0.5, 0.5, (wrong, 2))
    motion: MotionEstimate = assess_motion(R, T, x1, x2, 1e-3)
    return Sparse(Matches(x1, x2, x1, x2), [motion] * roots, (n, n), 800.0)


@pytest.mark.parametrize(
    ("windows", "large"),
    [
        (grid_windows(3, 3, 1000, 1000), True),
        (grid_windows(12, 12, 1000, 1000), True),
        (grid_windows(30, 30, 1000, 1000), False),
        ([(400, 400, 300, 300)], False),
    ],
    ids=["grid", "fine grid", "tiny cells", "one window"],
)
def test_the_quick_pass_is_for_large_windows_that_cover_the_image(windows: list[Window], large: bool) -> None:
    assert may_suffice(windows, GREY) == large


def test_many_matches_of_one_motion_decide() -> None:
    assert is_decided(sparse(400, wrong=10))
    assert not is_decided(sparse(100, wrong=0))
    assert not is_decided(sparse(400, wrong=120))
    assert not is_decided(sparse(400, wrong=10, roots=2))
    assert not is_decided(Sparse(sparse(400, 0).matches, [], (400, 400), 800.0))


def test_the_overview_is_as_fine_as_the_windows_need() -> None:
    assert overview_effort(grid_windows(3, 3, 1000, 1000), GREY) == COARSE
    assert overview_effort(grid_windows(12, 12, 1000, 1000), GREY) == FINE


@pytest.mark.parametrize("side", [64, 24], ids=["over the whole image", "around the window"])
def test_small_windows_have_the_full_overview_without_features_of_large_images(side: int) -> None:
    camera, (image1, image2) = load_camera(PAIR / "camera.json"), (load_image(PAIR / f"image{k}.png") for k in (1, 2))
    laps: list[str] = []

    def never(n_features: tuple[int, int], n_matches: int, n_agreeing: int) -> None:
        raise AssertionError("the full search for features has been made")

    images = image1.grey, image2.grey, camera, camera
    window = (300, 200, side, side)
    scene, _ = find_scene(*images, Options(), [window], check_sparse=never, on_lap=laps.append)
    assert laps == ["features", "overview"]
    around = scene.evidence.near(window, 3.0)  # as far as a window without matches borrows
    assert around.sum() > 0.5 * min((7 * side) ** 2, image1.grey.size) / 8**2  # half of the cells of 8 px
    assert np.ptp(scene.evidence.uv1, axis=0).min() > 0.5 * min(image1.grey.shape)  # and some all over image 1
