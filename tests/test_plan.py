"""What is planned is what happens: predicted sigmas against solved pairs, the baseline for a sigma, refusals."""

from __future__ import annotations

import dataclasses
import re
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from campaign import seeds

from slopecli.errors import InputError, NoAnswer
from slopecli.findings import beside
from slopecli.geometry import (
    cramer_rao_bound,
    homogeneous,
    lever,
    measure_slopes,
    normal_angle,
    rotation_from_vector,
    solve_planes,
)
from slopecli.plan import (
    Flight,
    PlanOptions,
    forecast,
    ground_normals,
    horizontal,
    make_plan,
    needed_baseline,
    unseen_tilts,
)
from slopecli.plan import flight as flight_module
from slopecli.study import UP, field_of_view_camera, project
from slopecli.types import Camera, FloatArray, IntArray, Solution
from slopecli.windows import grid_windows

CAMERA = field_of_view_camera()  # the paper's: 1024 x 1024 px, 60 degrees
NINE = tuple(grid_windows(3, 3, 1024, 1024))
PAPER_BASELINE = 0.2  # of the height
# nine windows in what both images of the paper show
SEEN = tuple((230 + 257 * column, 100 + 273 * row, 256, 272) for row in range(3) for column in range(3))
DOWN, EAST = -UP, np.array([1.0, 0.0, 0.0])
PAPER = PlanOptions(trajectory_deg=45.0, height=5.0, uneven_deg=10.0, roughness=0.0)


def along(trajectory_deg: float) -> FloatArray:
    return np.sin(np.radians(trajectory_deg)) * EAST + np.cos(np.radians(trajectory_deg)) * DOWN


def terrain(seed: int) -> FloatArray:
    """The paper's: every window tilted by 0 to 40 degrees at random; one height below the camera."""
    rng = np.random.default_rng(seed)
    normals = []
    for window in SEEN:
        downhill = horizontal(UP, rng.uniform(0.0, 2.0 * np.pi))
        normals.append(ground_normals(CAMERA, [window], UP, 0.0, downhill, rng.uniform(0.0, np.radians(40.0)))[0])
    return np.array(normals)


def flight(trajectory_deg: float, **values: object) -> Flight:
    plain = {"points": 30, "noise_px": 0.3, "roughness": 0.0}
    return Flight(CAMERA, SEEN, along(trajectory_deg), terrain(1), UP, **{**plain, **values})  # type: ignore[arg-type]


# ---- prediction ----


def test_prediction_is_the_cramer_rao_bound() -> None:
    plan = flight(45.0, points=256 * 10**6)  # so many that it does not matter that they are scattered
    seen = flight_module.see(plan, PAPER_BASELINE)
    bound = cramer_rao_bound(
        np.eye(3), plan.T, plan.normals * PAPER_BASELINE, seen.x1, seen.patch, 0.3e-3 / CAMERA.focal_px
    )
    empty = {field.name: np.zeros(0) for field in dataclasses.fields(Solution) if field.default is dataclasses.MISSING}
    names = {**empty, **bound._asdict(), "scaled_normals": plan.normals * PAPER_BASELINE}
    solution = Solution(**{key: value for key, value in names.items() if key != "ambiguity"})  # type: ignore[arg-type]
    assert forecast(plan, PAPER_BASELINE).sigma_rad == pytest.approx(measure_slopes(solution, UP).sigma_rad, rel=1e-6)


def trial(plan: Flight, baseline: float, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, IntArray]:
    """One pair: matches evenly at random over what both images show of every window, image 2 turned a little."""
    normals = plan.normals * baseline
    x1, patch = [], []
    for number, (x, y, w, h) in enumerate(plan.windows):
        uv = rng.uniform([x - 0.5, y - 0.5], [x + w - 0.5, y + h - 0.5], (plan.points, 2))
        rays = (uv - [plan.camera.cx, plan.camera.cy]) / [plan.camera.fx, plan.camera.fy]
        x2 = project(np.eye(3), plan.T, rays, homogeneous(rays) @ normals[number])
        uv2 = x2 * [plan.camera.fx, plan.camera.fy] + [plan.camera.cx, plan.camera.cy]
        inside = ((uv2 >= -0.5) & (uv2 < np.array([plan.camera.width, plan.camera.height]) - 0.5)).all(axis=1)
        x1.append(rays[inside])
        patch.append(np.full(int(inside.sum()), number))
    rays, label = np.concatenate(x1), np.concatenate(patch)
    depth = 1.0 / np.sum(normals[label] * homogeneous(rays), axis=1)
    depth *= 1.0 + plan.roughness * rng.standard_normal(len(depth))
    turn = rng.standard_normal(3)
    R = rotation_from_vector(np.radians(5.0) * turn / np.linalg.norm(turn))
    x2 = project(R, plan.T, rays, 1.0 / depth)
    return rays, x2 + plan.noise_px / plan.camera.focal_px * rng.standard_normal(x2.shape), label


def oblique() -> Flight:
    """Another camera, tilted by 20 degrees, over rough ground that slopes."""
    camera = field_of_view_camera(1200, 800, 70.0)
    up = np.array([0.0, -np.sin(np.radians(20.0)), -np.cos(np.radians(20.0))])
    windows = grid_windows(2, 2, 1200, 800)
    normals = ground_normals(camera, windows, up, np.radians(8.0), horizontal(up, 1.0), np.radians(6.0))
    direction = np.sin(np.radians(70.0)) * horizontal(up, np.pi / 2) - np.cos(np.radians(70.0)) * up
    return Flight(camera, windows, direction, normals, up, points=120, noise_px=0.2, roughness=0.003)


SETTINGS = {"paper 45": flight(45.0), "paper 90": flight(90.0), "oblique and rough": oblique()}


@pytest.mark.slow
@pytest.mark.parametrize("plan", SETTINGS.values(), ids=SETTINGS)
def test_sigmas_are_the_errors_of_solved_pairs(plan: Flight) -> None:
    """800 pairs solved: the RMS error of every window's slope is within 10 % of what was predicted."""
    predicted = forecast(plan, PAPER_BASELINE).sigma_rad
    truth = normal_angle(-plan.normals, plan.up)
    squares = []
    for seed in range(800):
        x1, x2, patch = trial(plan, PAPER_BASELINE, np.random.default_rng([5, seed]))
        solution = solve_planes(x1, x2, patch, relief=plan.roughness > 0.0)
        squares.append((measure_slopes(solution, plan.up).slope_rad - truth) ** 2)
    assert np.sqrt(np.mean(squares, axis=0)) == pytest.approx(predicted, rel=0.1)


def test_terrain_that_is_one_plane_has_two_answers_and_uneven_terrain_has_one() -> None:
    flat = make_plan(CAMERA, NINE, replace(PAPER, uneven_deg=0.0))
    assert flat.second_answer.likely
    assert "two answers are likely" in " ".join(one.message for one in flat.diagnostics)
    assert not make_plan(CAMERA, NINE, PAPER).second_answer.likely
    assert not make_plan(CAMERA, NINE, replace(PAPER, uneven_deg=0.0, trajectory_deg=90.0)).second_answer.likely


def test_what_the_first_of_two_answers_is_off_by_is_that_of_solved_pairs() -> None:
    """RMS over pairs of the first answer, of which about half are the wrong one by tens of degrees: within 25 %."""
    options = replace(PAPER, uneven_deg=0.0, points=100, noise_px=0.2)
    found = make_plan(CAMERA, SEEN, options)
    assert found.second_answer.first_error_deg > 20 * found.median_sigma_deg
    level = Flight(CAMERA, SEEN, along(45.0), np.tile(DOWN, (9, 1)), UP, points=100, noise_px=0.2, roughness=0.0)
    errors = []
    for seed in seeds(60, 30):
        solution = solve_planes(*trial(level, PAPER_BASELINE, np.random.default_rng([6, seed])))
        errors.append(np.degrees(measure_slopes(solution, UP).slope_rad))
    rms = float(np.median(np.sqrt(np.mean(np.square(errors), axis=0))))
    assert found.second_answer.first_error_deg == pytest.approx(rms, rel=0.25)


def test_straight_at_level_ground_the_sigma_is_that_of_pairs_not_of_a_covariance() -> None:
    """The covariance is without bound there, the answers are not: solved pairs are off by what is said."""
    plan = replace(PAPER, trajectory_deg=0.0, uneven_deg=0.0, points=100, noise_px=0.2)
    found = make_plan(CAMERA, SEEN, plan)
    assert found.sigma_source == "simulation"
    level = Flight(CAMERA, SEEN, DOWN, np.tile(DOWN, (9, 1)), UP, points=100, noise_px=0.2, roughness=0.0)
    errors = []
    for seed in seeds(60, 30):
        solution = solve_planes(*trial(level, PAPER_BASELINE, np.random.default_rng([6, seed])))
        errors.append(np.degrees(measure_slopes(solution, UP).slope_rad))
    assert found.median_sigma_deg == pytest.approx(
        float(np.median(np.sqrt(np.mean(np.square(errors), axis=0)))), rel=0.3
    )


def test_more_points_less_noise_and_a_longer_baseline_help() -> None:
    plain = make_plan(CAMERA, SEEN, PAPER).worst_sigma_deg
    assert plain is not None
    for better in ({"points": 200}, {"noise_px": 0.05}, {"height": 4.0}):
        assert make_plan(CAMERA, SEEN, replace(PAPER, **better)).worst_sigma_deg < 0.9 * plain
    for worse in ({"roughness": 0.01}, {"up_sigma_deg": 1.0}):
        assert make_plan(CAMERA, SEEN, replace(PAPER, **worse)).worst_sigma_deg > 1.1 * plain


def test_the_same_plan_twice_is_the_same() -> None:
    one, two = (make_plan(CAMERA, NINE, replace(PAPER, uneven_deg=0.0)) for _ in range(2))
    assert (one.windows, one.second_answer, one.diagnostics) == (two.windows, two.second_answer, two.diagnostics)


# ---- the baseline for a sigma ----


@pytest.mark.parametrize(
    ("trajectory_deg", "of"),
    [
        (0.0, "worst"),
        (45.0, "median"),
        *(
            pytest.param(trajectory_deg, of, marks=pytest.mark.slow)
            for trajectory_deg, of in ((45.0, "worst"), (90.0, "worst"), (0.0, "median"), (90.0, "median"))
        ),
    ],
)
def test_baseline_gives_the_sigma_and_a_shorter_one_does_not(of: str, trajectory_deg: float) -> None:
    plan = flight(trajectory_deg, points=100, noise_px=0.1)
    needed = needed_baseline(plan, np.radians(0.3), of)  # type: ignore[arg-type]
    at, shorter = (forecast(plan, length).sigma_rad for length in (needed, 0.99 * needed))
    pick = np.max if of == "worst" else np.median
    assert np.degrees(pick(at)) == pytest.approx(0.3, rel=1e-3)
    assert pick(shorter) > pick(at)
    assert (forecast(plan, needed).share >= 0.5).all()


def test_baseline_for_a_sigma_is_in_metres_with_a_height_and_in_heights_without() -> None:
    wanted = replace(PAPER, height=None, sigma_deg=0.5)
    share = make_plan(CAMERA, NINE, wanted)
    metres = make_plan(CAMERA, NINE, replace(wanted, height=80.0))
    assert (share.unit, share.height, metres.unit, metres.height) == ("height", 1.0, "m", 80.0)
    assert metres.baseline == pytest.approx(80.0 * share.baseline)
    assert share.worst_sigma_deg == pytest.approx(0.5, rel=1e-3)


@pytest.mark.slow
def test_a_sigma_no_baseline_reaches_is_refused_with_what_can_be_had() -> None:
    def refused(**values: object) -> str:
        with pytest.raises(NoAnswer) as error:
            make_plan(CAMERA, NINE, replace(PAPER, **{"height": None, "sigma_deg": 1e-3, **values}))  # type: ignore[arg-type]
        return str(error.value)

    for uneven in (0.0, 2.0):
        said = refused(trajectory_deg=90.0, uneven_deg=uneven, roughness=0.002)
        assert "with a longer baseline it grows again" in said
        (found,) = re.findall(
            r"0.001 deg in the worst window: the smallest sigma there is is (.*) deg, at (.*) of", said
        )
        smallest, place = map(float, found)
        options = replace(PAPER, trajectory_deg=90.0, uneven_deg=uneven, roughness=0.002)
        at, longer = (make_plan(CAMERA, NINE, replace(options, height=1.0 / b)) for b in (place, 1.2 * place))
        assert at.worst_sigma_deg == pytest.approx(smallest, rel=0.01)
        assert longer.worst_sigma_deg > smallest
        assert min(one.share_in_image2 for one in longer.windows) > 0.5  # that is not why
        reached = make_plan(CAMERA, NINE, replace(options, height=None, sigma_deg=1.001 * smallest))
        assert reached.baseline <= 1.01 * place
    said = refused(trajectory_deg=90.0, of="median", uneven_deg=0.0)
    assert "with a longer baseline some window has less than half of it in image 2" in said
    assert "slopes are left open at all of them" in refused(trajectory_deg=90.0, uneven_deg=0.0, noise_px=1000.0)
    with pytest.raises(NoAnswer, match=r"straight at ground that is one plane.*--uneven"):
        make_plan(CAMERA, NINE, replace(PAPER, height=None, sigma_deg=0.5, trajectory_deg=0.0, uneven_deg=0.0))


def test_a_window_that_sees_no_ground_has_no_baseline() -> None:
    horizon = replace(PAPER, height=None, sigma_deg=0.5, up=(0.0, -1.0, 0.0))
    with pytest.raises(NoAnswer, match="window 1 does not see the ground"):
        make_plan(CAMERA, NINE, horizon)


# ---- what image 2 does not show ----


def test_what_is_not_shown_is_doubted_as_estimate_doubts_it() -> None:
    from slopecli.geometry import plane_fit as unseen

    plan = flight(90.0)
    found = unseen_tilts(plan, 0.4)
    inside = flight_module.in_image2(plan, 0.4)
    assert np.array_equal(found == 0.0, inside.all(axis=1))
    assert 0 < np.count_nonzero(found) < len(found)
    for i in np.flatnonzero(found):
        assert found[i] == pytest.approx(unseen.BEND_RAD * unseen.lever(plan.places(i), inside[i]))


def test_doubt_of_half_a_window_is_that_of_a_plane_that_bends_at_its_middle() -> None:
    """Least squares over a window whose unseen half tilts by t give t / 2."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 41), np.linspace(-1.0, 1.0, 41))
    at = np.column_stack([x.ravel(), y.ravel()])
    tilt = np.linalg.lstsq(at, 0.1 * np.maximum(at[:, 0], 0.0), rcond=None)[0][0]
    assert lever(at, at[:, 0] <= 0.0) == pytest.approx(tilt / 0.1, rel=0.01)
    assert lever(at, np.zeros(len(at), bool)) == 1.0


def test_sigma_is_of_what_is_seen_and_the_rest_stands_beside_it() -> None:
    found = make_plan(CAMERA, NINE, replace(PAPER, trajectory_deg=90.0, uneven_deg=2.0))
    for one in found.windows:
        assert one.unseen_deg is not None
        assert (one.unseen_deg == 0.0) == (one.share_in_image2 == 1.0)
        assert one.unseen_deg < 10.0
    worst = min(found.windows, key=lambda one: one.share_in_image2)
    assert worst.unseen_deg > 5.0 * worst.slope_sigma_deg


# ---- windows and pairs that would be refused ----


def test_windows_that_leave_image_2_are_poor_then_refused() -> None:
    """Level flight to the right: the left column leaves first."""
    found = make_plan(CAMERA, NINE, replace(PAPER, trajectory_deg=90.0, height=4.0, uneven_deg=0.0))
    assert [one.status for one in found.windows] == ["poor", "ok", "ok"] * 3
    assert found.windows[0].reason == f"image 2 shows only {100 * found.windows[0].share_in_image2:.0f} % of it"
    found = make_plan(CAMERA, NINE, replace(PAPER, trajectory_deg=90.0, height=2.0, uneven_deg=0.0))
    assert [one.status for one in found.windows] == ["refused", "ok", "ok"] * 3
    assert (found.windows[0].slope_sigma_deg, found.worst_sigma_deg) == (None, None)
    assert found.windows[0].reason == "image 2 does not show its ground"
    assert found.median_sigma_deg is not None


def test_windows_above_the_horizon_are_refused() -> None:
    up = (0.0, -np.cos(np.radians(10.0)), -np.sin(np.radians(10.0)))  # looks 10 degrees below the horizon
    options = replace(PAPER, up=up, trajectory_deg=90.0, height=20.0, uneven_deg=2.0)
    assert [one.status for one in make_plan(CAMERA, NINE, options).windows][:3] == ["refused"] * 3


def test_without_parallax_or_overlap_there_is_no_plan() -> None:
    with pytest.raises(NoAnswer, match=r"pure-rotation.*no parallax"):
        make_plan(CAMERA, NINE, replace(PAPER, height=1e5))
    with pytest.raises(NoAnswer, match="no-overlap: image 2 shows none of the 9 windows"):
        make_plan(CAMERA, NINE, replace(PAPER, trajectory_deg=90.0, height=0.5))


def test_no_parallax_is_said_of_what_is_planned_not_of_matches() -> None:
    level = replace(PAPER, trajectory_deg=90.0)
    with pytest.raises(NoAnswer, match=r"parallax is [0-9]+ px at most, which among matches that err by 1000 px is no"):
        make_plan(CAMERA, NINE, replace(level, noise_px=1000.0))
    with pytest.raises(NoAnswer, match=r"parallax is 0\.00[0-9]+ px at most, which among matches that err by 0.1 px"):
        make_plan(CAMERA, NINE, replace(level, height=1e5))


@pytest.mark.parametrize("sigma_deg", [None, 0.5])
def test_up_that_points_down_is_told_from_windows_that_leave_image_2(sigma_deg: float | None) -> None:
    down = replace(PAPER, up=(0.0, 0.0, 1.0), sigma_deg=sigma_deg)
    with pytest.raises(NoAnswer, match=r"none of the 9 windows looks at the ground.*turn the sign of --up") as refused:
        make_plan(CAMERA, NINE, down)
    assert "shorten the baseline" not in str(refused.value)


def test_short_baseline_and_focus_of_expansion_are_said() -> None:
    codes = [one.code for one in make_plan(CAMERA, NINE, replace(PAPER, trajectory_deg=0.0, height=200.0)).diagnostics]
    assert "low-parallax" in codes
    assert "foe-in-window" in codes


def test_a_share_just_below_the_limit_is_not_rounded_onto_it() -> None:
    assert [beside(share, 50.0) for share in (43.21, 49.6, 49.98, 50.0)] == ["43", "49.6", "49.98", "50"]
    assert [beside(sigma, 10.0) for sigma in (24.2, 10.04)] == ["24", "10.04"]


def test_a_pair_none_of_whose_slopes_would_be_told_is_no_plan() -> None:
    with pytest.raises(NoAnswer, match=r"up-unknown.*all 9 windows are left open, as what is up is known to 89 deg"):
        make_plan(CAMERA, NINE, replace(PAPER, up_sigma_deg=89.0))
    with pytest.raises(NoAnswer, match=r"up-unknown.*up itself is known to 1 deg"):
        make_plan(CAMERA, NINE, replace(PAPER, height=None, sigma_deg=0.5, up_sigma_deg=1.0))


def test_the_baseline_for_a_sigma_is_none_that_estimate_would_call_too_short() -> None:
    level = replace(PAPER, trajectory_deg=90.0, uneven_deg=0.0, height=80.0, sigma_deg=0.5, roughness=0.002)
    found = make_plan(CAMERA, NINE, level)
    assert found.parallax_px == pytest.approx(3.0, rel=1e-3)
    assert found.worst_sigma_deg < 0.4
    (note,) = (one for one in found.diagnostics if one.code == "low-parallax")
    assert note.severity == "info"
    assert "a shorter baseline gives 0.5° as well, but less than the 3 px of parallax" in note.message
    sharper = make_plan(CAMERA, NINE, replace(level, sigma_deg=0.25))  # it takes more parallax than that anyway
    assert sharper.worst_sigma_deg == pytest.approx(0.25, rel=1e-3)
    assert not [one for one in sharper.diagnostics if one.code == "low-parallax"]


def test_windows_that_estimate_would_not_tell_are_poor() -> None:
    """In a long descent the middle window, which shows least parallax, is the first whose sigma is above 10 deg."""
    windows = make_plan(CAMERA, NINE, replace(PAPER, trajectory_deg=0.0, height=350.0, baseline=1.0)).windows
    assert [one.status for one in windows] == ["ok"] * 4 + ["poor"] + ["ok"] * 4
    assert windows[4].slope_sigma_deg > 10.0
    assert "--max-sigma" in windows[4].reason


# ---- ground, motion, options ----


def test_ground_has_the_slope_and_the_height_asked_for() -> None:
    up = np.array([0.1, -0.4, -0.9]) / np.linalg.norm([0.1, -0.4, -0.9])
    downhill = horizontal(up, 2.0)
    plain = ground_normals(CAMERA, NINE, up, np.radians(12.0), downhill, 0.0)
    assert np.degrees(normal_angle(-plain, up)) == pytest.approx(12.0)
    assert plain @ -up == pytest.approx(1.0)  # N.P = 1 for the point one height below the camera
    assert (-plain @ downhill > 0.0).all()
    uneven = ground_normals(CAMERA, NINE, up, np.radians(12.0), downhill, np.radians(5.0))
    assert np.degrees(normal_angle(uneven, plain)) == pytest.approx(5.0)


@pytest.mark.parametrize(("azimuth_deg", "expected"), [(0.0, [0, -1, 0]), (90.0, [1, 0, 0]), (180.0, [0, 1, 0])])
def test_azimuths_run_clockwise_from_the_top_of_the_image(azimuth_deg: float, expected: list[float]) -> None:
    assert horizontal(UP, np.radians(azimuth_deg)) == pytest.approx(np.array(expected, float))


def test_trajectories_are_the_papers() -> None:
    """0 descends, 45 glides, 90 flies level."""
    for angle in (0.0, 45.0, 90.0):
        found = make_plan(CAMERA, NINE, replace(PAPER, trajectory_deg=angle)).direction_cam1
        assert found == pytest.approx(along(angle))


@pytest.mark.parametrize("length", [1e-300, 1.0, 1e300])
def test_a_direction_has_any_length(length: float) -> None:
    found = make_plan(CAMERA, NINE, replace(PAPER, trajectory_deg=None, direction=(length, 0.0, length)))
    assert found.direction_cam1 == pytest.approx(along(45.0))


def test_options_that_contradict_are_refused() -> None:
    wrong = {
        "either the direction": {"direction": (1.0, 0.0, 0.0)},
        "a baseline and a sigma": {"baseline": 1.0, "sigma_deg": 0.5},
        "no height": {"height": None},
        "no plane is known": {"up": "dominant-plane"},
        "north is vertical": {"north": (0.0, 0.0, 1.0)},
    }
    for message, values in wrong.items():
        with pytest.raises(InputError, match=message):
            make_plan(CAMERA, NINE, replace(PAPER, **values))  # type: ignore[arg-type]


def test_lens_distortion_and_focal_lengths_count() -> None:
    """Twice the focal length at twice the pixels is twice as good at the same noise."""
    large = Camera(2048, 2048, 2 * CAMERA.fx, 2 * CAMERA.fy, 1023.5, 1023.5)
    double = tuple((2 * x, 2 * y, 2 * w, 2 * h) for x, y, w, h in SEEN)
    plain, fine = make_plan(CAMERA, SEEN, PAPER), make_plan(large, double, PAPER)
    assert plain.median_sigma_deg == pytest.approx(2.0 * fine.median_sigma_deg, rel=0.02)  # type: ignore[operator]
    bent = replace(CAMERA, model="brown", distortion=(-0.1, 0.01, 0.0, 0.0, 0.0))
    assert make_plan(bent, SEEN, PAPER).median_sigma_deg == pytest.approx(plain.median_sigma_deg, rel=0.3)


def test_prediction_loads_neither_opencv_nor_click() -> None:
    script = "import sys, slopecli.plan; sys.exit(any(name in sys.modules for name in ('cv2', 'PIL', 'click')))"
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0
