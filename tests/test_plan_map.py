"""The sigma that a plan predicts for discs of a map: that of maps, that of simulated noise, and its refusals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from slopecli.errors import InputError
from slopecli.io import load_image
from slopecli.io.cameras import camera_from_intrinsics, load_camera
from slopecli.options import MapOptions, Options
from slopecli.pipeline import slope_map
from slopecli.plan import PIXEL_NOISE, PlanOptions, draw_plan, make_plan
from slopecli.study import field_of_view_camera
from slopecli.windows import grid_windows

SAMPLE = Path(__file__).resolve().parent.parent / "sample_data" / "descent"


@pytest.mark.parametrize("footprint_px", [None, 100.0])
def test_sigma_of_a_map_is_that_of_the_sample(footprint_px: float | None) -> None:
    """The plan's windows lie on ground of other slopes than those of the plan, which hardly matters."""
    camera = load_camera(SAMPLE / "camera.json", size=(800, 800))
    images = [load_image(SAMPLE / f"image{number}.png") for number in (1, 2)]
    found = slope_map(*images, camera, camera, Options(), MapOptions(footprint_px=footprint_px, sites=0))
    options = PlanOptions(
        direction=(0.72, -0.46, -2.0),
        height=12.7,
        baseline=2.17,
        slope_deg=10.0,
        uneven_deg=8.0,
        noise_px=found.report.fit.noise_px,
        footprint_px=footprint_px,
    )
    planned = make_plan(camera, grid_windows(8, 8, 800, 800), options).map
    assert planned.footprint_px == found.footprint_px
    measured = float(np.median(found.sigma_deg[found.known]))
    assert planned.median_sigma_deg is not None
    assert 1 / 1.5 < planned.median_sigma_deg / measured < 1.5


def test_sigma_of_a_disc_is_that_of_ramps_fitted_to_simulated_noise() -> None:
    """Noise smoothed by the window of the alignment, on level ground seen from two places side by side."""
    focal_px, distance, diameter, noise_px = 700.0, 8.0, 60, 0.1
    camera = camera_from_intrinsics((focal_px, focal_px, 399.5, 399.5), 800, 800)
    options = PlanOptions(direction=(1.0, 0.0, 0.0), height=distance, noise_px=noise_px, footprint_px=float(diameter))
    sigma = make_plan(camera, [(350, 350, 100, 100)], options).map.median_sigma_deg
    y, x = np.mgrid[-diameter : diameter + 1, -diameter : diameter + 1]
    disc = np.hypot(x, y) <= diameter / 2
    shift_px = focal_px / distance
    tilts = []
    for seed in range(400):
        white = np.random.default_rng(seed).standard_normal(disc.shape).astype(np.float32)
        smooth = cv2.GaussianBlur(white, (0, 0), 2.5) * (np.sqrt(4 * np.pi) * 2.5)  # 1-sigma of 1
        error = PIXEL_NOISE * noise_px / shift_px * smooth
        tilts += [focal_px * (error * axis)[disc].sum() / (axis**2)[disc].sum() for axis in (x, y)]
    # of level ground the slope is the length of the tilt, whose mean square is that of both axes; noise that is shared
    # across the rim of the disc counts for less, which the prediction leaves out
    drawn = np.degrees(np.sqrt(2) * np.std(tilts))
    assert drawn < sigma < 1.2 * drawn


def test_sigma_of_a_map_falls_with_the_square_of_the_diameter_and_grows_with_the_noise() -> None:
    camera = field_of_view_camera(800, 800)
    windows = grid_windows(3, 3, 800, 800)

    def median(**changes: float) -> float:
        values = {"height": 8.0, "noise_px": 0.05, "footprint_px": 60.0, **changes}
        options = PlanOptions(trajectory_deg=90.0, **values)  # type: ignore[arg-type]
        found = make_plan(camera, windows, options).map.median_sigma_deg
        assert found is not None
        return found

    assert median() / median(footprint_px=120.0) == pytest.approx(4.0, rel=0.01)
    assert median(noise_px=0.1) / median() == pytest.approx(2.0, rel=0.01)
    assert median(height=16.0) / median() == pytest.approx(2.0, rel=0.1)  # half the parallax


def test_many_windows_without_room_for_labels_have_none_that_cover_each_other() -> None:
    options = PlanOptions(trajectory_deg=90.0, height=8.0)
    plan = make_plan(field_of_view_camera(800, 800), grid_windows(2, 2, 800, 800), options)
    places = [(400 + 16 * (k % 8), 400 + 16 * (k // 8), 16, 16) for k in range(64)]
    windows = tuple(replace(plan.windows[0], id=k + 1, window=place) for k, place in enumerate(places))
    inside = [draw_plan(replace(plan, windows=some))[404:412, 404:412] for some in (windows, windows[:63])]
    assert len(np.unique(inside[0].reshape(-1, 3), axis=0)) == 1
    assert len(np.unique(inside[1].reshape(-1, 3), axis=0)) > 1  # of fewer, each has its own


def test_a_disc_that_no_map_measures_is_refused() -> None:
    camera = field_of_view_camera(800, 800)
    options = PlanOptions(trajectory_deg=90.0, height=8.0, footprint_px=500.0)
    with pytest.raises(InputError, match="between 12 and 400 px"):
        make_plan(camera, grid_windows(3, 3, 800, 800), options)
