"""Two images in, slopes out: the whole line on the descent sample, whose truth is known exactly.

Margins are about twice the errors found. The windows of the grid hold boulders and craters, the smooth windows do not.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from slopecli.errors import InputError, NoAnswer
from slopecli.geometry import (
    direction_angle,
    homogeneous,
    normal_angle,
    pixels_from_rays,
    rays_from_pixels,
    rotation_angle,
)
from slopecli.io import load_image
from slopecli.io.cameras import load_camera
from slopecli.options import Options
from slopecli.pipeline import estimate
from slopecli.products import report_to_json
from slopecli.types import BoolArray, Camera, FloatArray, Image, Report
from slopecli.windows import Window

FOLDER = Path(__file__).resolve().parent.parent / "sample_data" / "descent"
TRUTH = json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))
R, T = np.array(TRUTH["R"]), np.array(TRUTH["T"])
CAMERA = load_camera(FOLDER / "camera.json", size=(800, 800))
IMAGE1, IMAGE2 = load_image(FOLDER / "image1.png"), load_image(FOLDER / "image2.png")
# a quarter turn of image 1, clockwise, and what it does to its camera's axes
QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def windows_of(name: str) -> tuple[Window, ...]:
    return tuple((w["x"], w["y"], w["w"], w["h"]) for w in TRUTH[name])


def true_normals(name: str) -> FloatArray:
    return np.array([w["normal_cam1"] for w in TRUTH[name]])


SMOOTH = windows_of("smooth_windows")


def run(
    image1: Image = IMAGE1, image2: Image = IMAGE2, camera1: Camera = CAMERA, camera2: Camera = CAMERA, **options: Any
) -> Report:
    return estimate(image1, image2, camera1, camera2, Options(**options))


STAGES: list[tuple[str, float]] = []


@lru_cache(maxsize=1)
def nine_windows() -> Report:
    """The answer of the ordinary run, which many tests look at; its stages are told in STAGES."""
    return estimate(IMAGE1, IMAGE2, CAMERA, CAMERA, Options(), on_stage=lambda *told: STAGES.append(told))


@lru_cache(maxsize=1)
def metres_and_uncertain_up() -> Report:
    return run(up=(0.0, 0.0, -1.0), up_sigma_deg=1.5, baseline_m=float(np.linalg.norm(T)))


@lru_cache(maxsize=1)
def smooth_windows() -> Report:
    return run(windows=SMOOTH)


def normals_of(report: Report) -> FloatArray:
    assert [plane.id for plane in report.planes] == list(range(1, 10))
    return np.array([plane.normal_cam1 for plane in report.planes])


def slopes_of(report: Report) -> FloatArray:
    return np.array([plane.slope_deg for plane in report.planes])


def sigmas_of(report: Report) -> FloatArray:
    return np.array([plane.slope_sigma_deg for plane in report.planes])


def seen_whole(name: str) -> BoolArray:
    """(9,) windows of which image 2 shows nearly everything."""
    return np.array([window["visible_fraction"] > 0.95 for window in TRUTH[name]])


def errors_deg(report: Report, name: str = "windows", turned_by: FloatArray | None = None) -> FloatArray:
    """(9,) angles to the true normals; `turned_by`: camera axes of the report to those of the truth."""
    found = normals_of(report) if turned_by is None else normals_of(report) @ turned_by.T
    return np.degrees([normal_angle(a, b) for a, b in zip(found, true_normals(name), strict=True)])


def motion_errors_deg(report: Report) -> tuple[float, float]:
    motion = report.motion
    rotation = float(rotation_angle(motion.rotation_cam2_from_cam1, R))
    return float(np.degrees(rotation)), float(np.degrees(direction_angle(motion.baseline_cam1, T)))


def with_grey(image: Image, grey: FloatArray) -> Image:
    return replace(image, grey=np.ascontiguousarray(np.clip(np.round(grey), 0, 255).astype(np.uint8)))


def halved(image: Image) -> Image:
    return with_grey(image, cv2.resize(image.grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA).astype(float))


def turned(image: Image) -> Image:
    return with_grey(image, np.rot90(image.grey, -1).astype(float))


def turned_camera() -> Camera:
    return replace(CAMERA, cx=CAMERA.height - 1 - CAMERA.cy, cy=CAMERA.cx)


def turned_window(window: Window) -> Window:
    x, y, w, h = window
    return CAMERA.height - y - h, x, h, w


# ---- accuracy ----


def test_all_nine_windows_of_the_grid() -> None:
    errors = errors_deg(nine_windows())
    assert errors.max() < 0.8
    assert np.median(errors) < 0.4
    assert nine_windows().rejected == ()
    assert {plane.status for plane in nine_windows().planes} == {"ok"}


def test_smooth_windows_are_better_still() -> None:
    errors = errors_deg(smooth_windows(), "smooth_windows")
    assert errors.max() < 0.5
    assert np.median(errors) < 0.15


@pytest.mark.parametrize("name", ["windows", "smooth_windows"])
def test_slopes_are_as_sure_as_they_say(name: str) -> None:
    report = nine_windows() if name == "windows" else smooth_windows()
    true_slopes = np.array([window["slope_deg"] for window in TRUTH[name]])
    off = np.abs(slopes_of(report) - true_slopes) / sigmas_of(report)
    assert off.max() < 4
    assert (off < 2.5).sum() >= 8
    assert sigmas_of(report)[seen_whole(name)].max() < 0.6


def test_the_less_is_seen_of_a_window_the_less_sure_is_its_slope() -> None:
    """Image 2 shows more ground than image 1, so with their parts exchanged the outer windows are cut."""
    planes = run(IMAGE2, IMAGE1).planes
    share = np.array([plane.n_correspondences for plane in planes]) / max(p.n_correspondences for p in planes)
    sigmas = np.array([plane.slope_sigma_deg for plane in planes])
    whole, cut = share > 0.95, share < 0.75
    assert whole.sum() >= 1
    assert cut.sum() >= 3
    assert (sigmas[cut] > 3 * sigmas[whole].max()).all()
    assert np.corrcoef(share, sigmas)[0, 1] < -0.8


def test_the_motion() -> None:
    rotation, direction = motion_errors_deg(nine_windows())
    assert rotation < 0.02
    assert direction < 0.1
    assert rotation < 4 * nine_windows().motion.rotation_sigma_deg
    assert direction < 4 * nine_windows().motion.direction_sigma_deg
    assert nine_windows().ambiguity.status != "unresolved"


@pytest.mark.parametrize("name", ["windows", "smooth_windows"])
def test_verdicts_are_those_of_the_true_slopes_where_the_window_is_seen(name: str) -> None:
    report = nine_windows() if name == "windows" else smooth_windows()
    expected = np.array(["safe" if window["slope_deg"] < 15 else "unsafe" for window in TRUTH[name]])
    verdicts, whole = np.array([plane.verdict for plane in report.planes]), seen_whole(name)
    assert (verdicts[whole] == expected[whole]).all()
    assert ((verdicts == expected) | (verdicts == "undecided"))[~whole].all()


def test_the_window_with_the_epipole_is_named() -> None:
    (found,) = [d for d in nine_windows().diagnostics if d.code == "foe-in-window"]
    epipole = pixels_from_rays(CAMERA, T[None, :2] / T[2])[0]
    x, y, w, h = windows_of("windows")[int(found.value or 0) - 1]
    assert x <= epipole[0] < x + w
    assert y <= epipole[1] < y + h
    assert nine_windows().epipole1_px == pytest.approx(tuple(epipole), abs=1.0)


@pytest.mark.parametrize(("options", "worst", "typical"), [({"solver": "ha"}, 0.9, 0.5), ({"solver": "lh"}, 7.0, 2.0)])
def test_the_papers_solvers_answer_too(options: dict[str, str], worst: float, typical: float) -> None:
    errors = errors_deg(run(**options))
    assert errors.max() < worst
    assert np.median(errors) < typical
    assert np.mean(errors) > np.mean(errors_deg(nine_windows()))


def test_the_papers_features_answer_too() -> None:
    errors = errors_deg(run(features="foerstner"))
    assert errors.max() < 1.4
    assert np.median(errors) < 0.6


# ---- the same answer ----


def test_same_inputs_give_the_same_bytes_whatever_was_drawn_before() -> None:
    np.random.seed(7)
    cv2.setRNGSeed(7)
    again = run()
    assert report_to_json(again) == report_to_json(nine_windows())
    assert np.array_equal(again.labels, nine_windows().labels)


def test_stages_are_told_in_order() -> None:
    nine_windows()
    assert [name for name, _ in STAGES] == ["features", "overview", "windows", "solve", "dense windows", "report"]
    assert all(seconds >= 0 for _, seconds in STAGES)


def test_windows_keep_their_order_and_do_not_depend_on_it() -> None:
    backwards = run(windows=SMOOTH[::-1])
    assert [plane.id for plane in backwards.planes] == list(range(1, 10))
    for plane, window in zip(backwards.planes, SMOOTH[::-1], strict=True):
        assert tuple(plane.polygon_px[0] + 0.5) == window[:2]
    assert normals_of(backwards)[::-1] == pytest.approx(normals_of(smooth_windows()), abs=1e-6)


@pytest.mark.slow
def test_exposure_does_not_matter() -> None:
    darker = run(image1=with_grey(IMAGE1, 0.8 * IMAGE1.grey))
    assert slopes_of(darker) == pytest.approx(slopes_of(nine_windows()), abs=0.15)


@pytest.mark.slow
def test_a_quarter_turn_of_image_2_changes_nothing_in_the_frame_of_image_1() -> None:
    report = run(image2=turned(IMAGE2), camera2=turned_camera())
    assert np.degrees(normal_angle(normals_of(report), normals_of(nine_windows()))).max() < 0.15
    assert rotation_angle(report.motion.rotation_cam2_from_cam1, QUARTER_TURN @ R) < np.radians(0.02)


def test_a_quarter_turn_of_image_1_turns_normals_and_leaves_slopes() -> None:
    windows = tuple(map(turned_window, windows_of("windows")))
    report = run(image1=turned(IMAGE1), camera1=turned_camera(), windows=windows)
    assert errors_deg(report, turned_by=QUARTER_TURN.T).max() < 0.8
    assert slopes_of(report) == pytest.approx(slopes_of(nine_windows()), abs=0.4)
    # aspects are counted from the top of the image, which has turned with it
    for upright, lying in zip(nine_windows().planes, report.planes, strict=True):
        if upright.aspect_deg is not None and lying.aspect_deg is not None and upright.slope_deg > 5:
            assert (lying.aspect_deg - upright.aspect_deg) % 360 == pytest.approx(90, abs=2)


def image_2_window(window: dict[str, Any]) -> Window:
    """The largest upright window of image 2 on the ground that a window of image 1 shows."""
    x, y, w, h = (window[name] for name in "xywh")
    corners = np.array([[x, y], [x + w - 1, y], [x + w - 1, y + h - 1], [x, y + h - 1]], float)
    rays, normal = homogeneous(rays_from_pixels(CAMERA, corners)), np.array(window["normal_cam1"])
    points = (rays * (-window["distance_m"] / (rays @ normal))[:, None] - T) @ R.T
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = pixels_from_rays(CAMERA, points[:, :2] / points[:, 2:])
    left, top = int(np.ceil(max(x0, x3))), int(np.ceil(max(y0, y1)))
    return left, top, int(min(x1, x2)) - left, int(min(y2, y3)) - top


def test_images_swapped_give_the_same_ground_seen_from_the_other_camera() -> None:
    report = run(IMAGE2, IMAGE1, windows=tuple(map(image_2_window, TRUTH["smooth_windows"])))
    assert errors_deg(report, "smooth_windows", turned_by=R.T).max() < 0.5
    assert rotation_angle(report.motion.rotation_cam2_from_cam1, R.T) < np.radians(0.02)
    assert direction_angle(report.motion.baseline_cam1, -R @ T) < np.radians(0.1)


# ---- cameras ----


def test_two_different_cameras() -> None:
    """Image 2 at three quarters of its size, as from another sensor."""
    small = with_grey(IMAGE2, cv2.resize(IMAGE2.grey, (600, 600), interpolation=cv2.INTER_AREA).astype(float))
    centre = 0.75 * (CAMERA.cx + 0.5) - 0.5
    other = replace(CAMERA, width=600, height=600, fx=0.75 * CAMERA.fx, fy=0.75 * CAMERA.fy, cx=centre, cy=centre)
    report = run(image2=small, camera2=other)
    assert errors_deg(report).max() < 0.8
    assert motion_errors_deg(report)[0] < 0.02


def test_lens_distortion_is_heeded() -> None:
    """Without the camera's distortion, of 4 % at most, the answer is worse by degrees."""
    ideal = replace(CAMERA, model="pinhole", distortion=())
    ignored = errors_deg(run(camera1=ideal, camera2=ideal))
    assert np.median(ignored) > 5 * np.median(errors_deg(nine_windows()))
    assert ignored.max() > 4


# ---- up ----


def test_up_moves_slopes_and_not_normals() -> None:
    up = TRUTH["windows"][4]["normal_cam1"]
    report = run(up=tuple(up))
    assert report.up.source == "given"
    assert normals_of(report) == pytest.approx(normals_of(nine_windows()), abs=1e-9)
    expected = np.degrees(normal_angle(true_normals("windows"), np.array(up)))
    assert slopes_of(report) == pytest.approx(expected, abs=0.8)
    assert report.planes[4].slope_deg < 0.8


def test_the_largest_window_can_be_level() -> None:
    windows = (*SMOOTH[:4], windows_of("windows")[4])
    report = run(windows=windows, up="dominant-plane")
    assert report.up.source == "dominant-plane"
    assert report.up.vector_cam1 == pytest.approx(report.planes[4].normal_cam1)
    assert report.planes[4].slope_deg == pytest.approx(0, abs=1e-6)
    expected = np.degrees(normal_angle(true_normals("smooth_windows")[:4], true_normals("windows")[4]))
    assert slopes_of(report)[:4] == pytest.approx(expected, abs=0.8)


def test_the_uncertainty_of_up_is_the_slopes_too() -> None:
    report = metres_and_uncertain_up()
    assert slopes_of(report) == pytest.approx(slopes_of(nine_windows()))
    assert sigmas_of(report) == pytest.approx(np.hypot(sigmas_of(nine_windows()), 1.5), rel=0.25)


def test_a_baseline_makes_metres() -> None:
    report = metres_and_uncertain_up()
    assert report.scale.unit == "m"
    assert report.motion.baseline_cam1 == pytest.approx(T, abs=0.01)
    expected = [window["distance_m"] for window in TRUTH["windows"]]
    assert [plane.distance for plane in report.planes] == pytest.approx(expected, rel=0.01)


# ---- single and hidden windows ----


@pytest.mark.parametrize(
    "number", [number if number == 4 else pytest.param(number, marks=pytest.mark.slow) for number in range(9)]
)
def test_one_window_profits_from_the_rest_of_the_image(number: int) -> None:
    (plane,) = run(windows=(SMOOTH[number],)).planes
    assert np.degrees(normal_angle(plane.normal_cam1, true_normals("smooth_windows")[number])) < 0.6


@pytest.mark.parametrize(("corner", "facet"), [((0, 740), 7), pytest.param((740, 740), 9, marks=pytest.mark.slow)])
def test_a_small_window_in_a_corner_that_both_images_show(corner: tuple[int, int], facet: int) -> None:
    """Sixty pixels of a facet are not all of it: its own relief tilts them by up to three degrees."""
    (plane,) = run(windows=((*corner, 60, 60),)).planes
    assert plane.status == "ok"
    assert plane.slope_sigma_deg < 3
    assert np.degrees(normal_angle(plane.normal_cam1, true_normals("windows")[facet - 1])) < 3.5


@pytest.mark.parametrize(
    ("corner", "facet"),
    [
        ((0, 0), 1),
        pytest.param((740, 0), 3, marks=pytest.mark.slow),
        pytest.param((0, 740), 7, marks=pytest.mark.slow),
        pytest.param((740, 740), 9, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_a_corner_that_image_2_does_not_show_is_answered_with_doubt(corner: tuple[int, int], facet: int) -> None:
    """Image 2 shows more ground, so with their parts exchanged the corners of the first are not in the second."""
    (plane,) = run(IMAGE2, IMAGE1, windows=((*corner, 60, 60),)).planes
    assert plane.status == "poor"
    assert "not in image 2" in str(plane.reason)
    assert plane.verdict != "safe"
    true_slope = np.degrees(normal_angle(R @ true_normals("windows")[facet - 1], np.array([0.0, 0.0, -1.0])))
    low, high = plane.slope_ci95_deg
    assert low <= true_slope <= high


@pytest.mark.parametrize("paint", ["flat", pytest.param("noise", marks=pytest.mark.slow)])
def test_a_window_that_shows_nothing_does_not_pass_for_seen_and_harms_no_other(paint: str) -> None:
    x, y, w, h = SMOOTH[4]
    grey = IMAGE1.grey.astype(float)
    grey[y : y + h, x : x + w] = 128 if paint == "flat" else np.random.default_rng(0).uniform(0, 255, (h, w))
    report = run(image1=with_grey(IMAGE1, grey), windows=SMOOTH)
    others = {plane.id: plane for plane in report.planes}
    painted = others.pop(5, None)
    assert painted is None or (painted.status == "poor" and painted.slope_sigma_deg > 5 and painted.verdict != "safe")
    assert sorted(others) == [1, 2, 3, 4, 6, 7, 8, 9]
    for number, plane in others.items():
        assert np.degrees(normal_angle(plane.normal_cam1, true_normals("smooth_windows")[number - 1])) < 0.5


# ---- refusals ----


@pytest.mark.parametrize(
    ("window", "said"),
    [
        ((700, 0, 101, 50), r"window 2 \(700,0,101,50\) is not inside image 1, which is 800x800 px"),
        ((0, 790, 50, 50), r"window 2 .* is not inside image 1"),
        ((-1, 0, 50, 50), r"window 2 .* is not inside image 1"),
        ((10, 10, 15, 100), r"window 2 is 15x100 px, at least 16x16 are needed"),
    ],
)
def test_a_window_that_cannot_be_is_refused_by_its_number(window: Window, said: str) -> None:
    with pytest.raises(InputError, match=said):
        run(windows=(SMOOTH[0], window))


def test_a_grid_too_fine_for_the_image_is_refused() -> None:
    with pytest.raises(InputError, match="at least 16x16 px each; use at most"):
        run(grid=(100, 100))


def test_the_same_image_twice_is_refused() -> None:
    with pytest.raises(NoAnswer) as refusal:
        run(image2=IMAGE1)
    assert refusal.value.code == "pure-rotation"


def test_another_place_is_refused() -> None:
    """Both at half their size: to be sure that nothing matches takes a long search."""
    town = load_image(FOLDER.parent / "urban" / "image1.png")
    small, other = (halved(image) for image in (IMAGE1, town))
    camera = load_camera(FOLDER / "camera.json", size=(small.width, small.height))
    town_camera = load_camera(FOLDER.parent / "urban" / "camera.json", size=(other.width, other.height))
    with pytest.raises(NoAnswer) as refusal:
        run(small, other, camera, town_camera)
    assert refusal.value.code == "no-overlap"


def test_blank_images_are_refused() -> None:
    rng = np.random.default_rng(0)
    blank = [with_grey(IMAGE1, 128 + rng.normal(0, 1, IMAGE1.grey.shape)) for _ in range(2)]
    with pytest.raises(NoAnswer) as refusal:
        run(*blank)
    assert refusal.value.code == "low-texture"


def test_a_camera_that_only_turned_is_refused() -> None:
    """Image 1 as a camera turned by 4 degrees would see it."""
    turn = cv2.Rodrigues(np.radians([2.0, -3.0, 1.5]))[0]
    pixels = np.stack(np.meshgrid(np.arange(800.0), np.arange(800.0)), axis=-1).reshape(-1, 2)
    rays = homogeneous(rays_from_pixels(CAMERA, pixels)) @ turn
    source = pixels_from_rays(CAMERA, rays[:, :2] / rays[:, 2:]).reshape(800, 800, 2).astype(np.float32)
    seen = cv2.remap(IMAGE1.grey, source[..., 0], source[..., 1], cv2.INTER_CUBIC).astype(float)
    with pytest.raises(NoAnswer) as refusal:
        run(image2=with_grey(IMAGE1, seen + np.random.default_rng(0).normal(0, 1, seen.shape)))
    assert refusal.value.code == "pure-rotation"


def test_what_was_done_in_reading_an_image_is_said() -> None:
    report = run(image2=replace(IMAGE2, note="its EXIF orientation 6 was not applied"), windows=SMOOTH[:1])
    said = [d.message for d in report.diagnostics if d.code == "image-note"]
    assert said == ["image 2: its EXIF orientation 6 was not applied"]
