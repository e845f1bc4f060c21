"""What the paper says, checked: its printed results, the facts docs/paper.md adds, and where its equations are."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from slopecli.geometry import (
    align_homographies,
    decompose_homography,
    direction_angle,
    homography_of_plane,
    measure_slopes,
    rotation_angle,
    solve_planes,
)
from slopecli.study import UP, make_scene, paper_scene, paper_study

ROOT = Path(__file__).parents[1]


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.fixture(scope="module")
def study() -> dict[tuple[str, float], list]:
    """The 120 trials of section 4.1 at 0.3 px, by solver and trajectory."""
    trials: dict[tuple[str, float], list] = {}
    for trial in paper_study(noises_px=(0.3,)):
        trials.setdefault((trial.solver, trial.trajectory_deg), []).append(trial)
    return trials


@pytest.mark.slow
@pytest.mark.parametrize("trajectory", [0.0, 45.0, 90.0])
def test_printed_accuracy_of_alignment(study: dict, trajectory: float) -> None:
    """Rotation below 0.1 deg, translation about 0.5 % vertical and 0.25 % otherwise, normals within 1 deg, no failure.

    An RMS of 40 terrains scatters by 11 %, and more as the errors of HA have a heavy tail: other sets of terrains, or
    another one of the equally large windows as base, give 0.07 to 0.10 deg, 0.57 to 0.61 % and 0.9 to 1.1 deg for
    vertical descent. Three times that scatter is allowed for there.
    """
    trials, scatter = study["ha", trajectory], 1.33 if trajectory == 0.0 else 1.2
    assert all(trial.reason is None for trial in trials)
    assert np.degrees(rms([t.rotation_error for t in trials])) < 0.1
    assert rms([t.direction_error for t in trials]) < scatter * (0.005 if trajectory == 0.0 else 0.0025)
    assert np.degrees(np.sqrt(np.mean([t.normal_errors**2 for t in trials], axis=0))).max() < (
        scatter if trajectory == 0.0 else 1.0
    )


@pytest.mark.slow
@pytest.mark.parametrize("trajectory", [0.0, 45.0, 90.0])
def test_alignment_is_twice_as_good_as_averaged_motions(study: dict, trajectory: float) -> None:
    errors = {solver: rms([t.rotation_error for t in study[solver, trajectory]]) for solver in ("mle", "ha", "lh")}
    assert errors["lh"] > 2.0 * errors["ha"]
    assert errors["ha"] > 1.5 * errors["mle"]


@pytest.mark.slow
def test_vertical_descent_is_the_least_accurate_and_worst_at_the_focus_of_expansion(study: dict) -> None:
    for solver in ("mle", "ha"):
        by_trajectory = {t: rms([trial.rotation_error for trial in study[solver, t]]) for t in (0.0, 45.0, 90.0)}
        assert max(by_trajectory, key=by_trajectory.__getitem__) == 0.0
        by_window = np.mean([trial.normal_errors**2 for trial in study[solver, 0.0]], axis=0)
        assert int(np.argmax(by_window)) == 4  # the middle one, which holds the focus of expansion


@pytest.mark.slow
def test_alternation_is_slow_and_more_sweeps_do_not_help() -> None:
    """Fifty sweeps do not settle to 1e-10, and five hundred leave the motion no better than a hundred."""
    few, many = [], []
    for seed in range(6):
        scene = paper_scene(np.random.default_rng([2, seed]), 45.0, 0.3)
        fifty = align_homographies(scene.x1, scene.x2, scene.patch, tolerance=1e-10, max_sweeps=50)[0]
        assert not fifty.converged
        few.append(rotation_angle(align_homographies(scene.x1, scene.x2, scene.patch, 0.0, 100)[0].R, scene.R))
        many.append(rotation_angle(align_homographies(scene.x1, scene.x2, scene.patch, 0.0, 500)[0].R, scene.R))
    assert rms(many) > 0.8 * rms(few)


def test_joint_least_squares_takes_a_handful_of_iterations() -> None:
    iterations = [
        solve_planes(scene.x1, scene.x2, scene.patch).iterations
        for scene in (paper_scene(np.random.default_rng([3, seed]), 45.0, 0.3) for seed in range(20))
    ]
    assert max(iterations) <= 5


@pytest.mark.parametrize("trajectory", [15.0, 30.0, 45.0])
def test_second_root_of_a_plane_survives_full_visibility(trajectory: float) -> None:
    """One plane, motion up to 45 deg from vertical: both readings see every point from both places, nearly always."""
    both = 0
    for seed in range(20):
        scene = make_scene(
            np.random.default_rng([4, seed]), trajectory_deg=trajectory, grid=(1, 1), max_slope_deg=20.0, noise_px=0.0
        )
        H = homography_of_plane(scene.R, scene.T, scene.normals[0])
        both += len(decompose_homography(H, scene.x1)) == 2
    assert both >= 18


def test_steep_plane_in_vertical_descent_has_a_gentle_twin() -> None:
    """Every plane steeper than 15 deg has a second visible answer below 15 deg: picking by residual is a coin toss."""
    for slope in (16.0, 20.0, 30.0, 40.0):
        scene = make_scene(
            np.random.default_rng(5), trajectory_deg=0.0, grid=(1, 1), points=100, slopes_deg=[slope], height_spread=0.0
        )
        solution = solve_planes(scene.x1, scene.x2, scene.patch)
        assert solution.ambiguity.status == "unresolved"
        assert solution.ambiguity.alternative is not None
        found = sorted(
            float(np.degrees(measure_slopes(root, UP).slope_rad[0]))
            for root in (solution, solution.ambiguity.alternative)
        )
        assert found[0] < 15.0
        assert found[1] == pytest.approx(slope, abs=1.0)


def test_residual_alone_tells_nothing_on_one_plane() -> None:
    for seed in range(20):
        scene = make_scene(np.random.default_rng([6, seed]), trajectory_deg=30.0, grid=(1, 1), slopes_deg=[5.0])
        found = solve_planes(scene.x1, scene.x2, scene.patch)
        assert found.ambiguity.status == "unresolved"
        assert found.ambiguity.alternative is not None
        assert found.ambiguity.delta_chi2 == pytest.approx(0.0, abs=1e-6)
        off = [direction_angle(root.T, scene.T) for root in (found, found.ambiguity.alternative)]
        assert min(off) < np.radians(10.0) < max(off)


@pytest.mark.parametrize("number", range(1, 18))
def test_every_equation_is_one_search_away(number: int) -> None:
    code = "\n".join(path.read_text() for path in (ROOT / "slopecli").rglob("*.py"))
    assert f"eq. ({number})" in code


def test_every_test_the_page_names_exists() -> None:
    page = (ROOT / "docs" / "paper.md").read_text()
    named = re.findall(r"`(test_\w+)::(test_\w+)`", page)
    assert len(named) > 20
    for module, function in named:
        assert f"def {function}(" in (ROOT / "tests" / f"{module}.py").read_text(), f"{module}::{function}"
