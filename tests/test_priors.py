"""A motion known beforehand: exact derivatives, worth what its sigma says, and no more."""

from __future__ import annotations

import numpy as np
import pytest
from campaign import seeds

from slopecli.errors import InputError
from slopecli.geometry import normal_angle, rotation_angle, rotation_from_vector, rotation_vector, solve_planes
from slopecli.geometry.solver import MotionPrior, cramer_rao_bound
from slopecli.study import Scene, make_scene
from slopecli.types import FloatArray, Solution

DEG = np.pi / 180


def flat_descent(seed: int, trajectory_deg: float = 0.0) -> Scene:
    """The nominal landing: straight down over level ground, the worst-conditioned case there is."""
    rng = np.random.default_rng(seed)
    return make_scene(rng, trajectory_deg=trajectory_deg, slopes_deg=[0.0] * 9, height_spread=0.0, noise_px=0.3)


def measured(scene: Scene, seed: int, rotation_sigma: float = np.inf, direction_sigma: float = np.inf) -> MotionPrior:
    """What a sensor of these sigmas, rad, would say of a scene's motion."""
    rng = np.random.default_rng(1000 + seed)
    known = MotionPrior()
    if np.isfinite(rotation_sigma):
        known = MotionPrior(rotation_from_vector(rotation_sigma * rng.normal(size=3)) @ scene.R, rotation_sigma)
    if np.isfinite(direction_sigma):
        aside = direction_sigma * rng.normal(size=3)
        direction = scene.T + aside - (aside @ scene.T) * scene.T
        known = MotionPrior(known.rotation, known.rotation_sigma, direction, direction_sigma)
    return MotionPrior.checked(known.rotation, known.rotation_sigma, known.direction, known.direction_sigma)


def solved(scene: Scene, prior: MotionPrior | None = None, **options: object) -> Solution:
    return solve_planes(scene.x1, scene.x2, scene.patch, prior=prior, **options)  # type: ignore[arg-type]


def tilts(scene: Scene, solution: Solution) -> FloatArray:
    """(m, 2) by how much the normals lean too far, rad."""
    lean = lambda N: N[:, :2] / N[:, 2:]  # noqa: E731
    return np.asarray(lean(solution.scaled_normals) - lean(scene.normals))


@pytest.mark.parametrize("which", ["rotation", "direction", "both"])
def test_gradient_is_the_derivative_of_what_it_costs(which: str) -> None:
    rng = np.random.default_rng(5)
    R, T = rotation_from_vector(0.3 * rng.normal(size=3)), np.array([0.6, -0.64, 0.48])
    known = MotionPrior(
        rotation_from_vector(0.05 * rng.normal(size=3)) @ R if which != "direction" else None,
        0.01,
        np.array([0.5, -0.7, 0.51]) if which != "rotation" else None,
        0.02,
    )

    def cost(step: FloatArray) -> float:
        turned, moved = rotation_from_vector(step[:3]) @ R, T + step[3:]
        moved = moved / np.linalg.norm(moved)
        return float(known.terms(turned[None], moved[None], 0.001)[0, 6, 6])

    gradient = known.terms(R[None], T[None], 0.001)[0, 6, :6]
    for k, unit in enumerate(np.eye(6)):
        slope = (cost(1e-5 * unit) - cost(-1e-5 * unit)) / 4e-5  # the gradient is half the derivative
        assert gradient[k] == pytest.approx(slope, rel=1e-3, abs=1e-7)


@pytest.mark.slow
def test_rotation_known_makes_a_descent_over_level_ground_as_sure_as_can_be() -> None:
    """Within 10 % of the bound: over 120 scenes with 18 tilts each that share a motion, RMS is known to 5 %."""
    sigma = 0.1 * DEG
    errors, bound = [], []
    for seed in range(120):
        scene = flat_descent(seed)
        errors.append(tilts(scene, solved(scene, measured(scene, seed, sigma))))
        centred = MotionPrior(scene.R, sigma)
        least = cramer_rao_bound(scene.R, scene.T, scene.normals, scene.x1, scene.patch, scene.noise, centred)
        length = np.linalg.norm(scene.normals, axis=1)
        bound.append(np.sqrt(least.normal_covariance[:, [0, 1], [0, 1]]) / length[:, None])
    rms, least_rms = np.sqrt(np.mean(np.square(errors))), np.sqrt(np.mean(np.square(bound)))
    assert rms == pytest.approx(least_rms, rel=0.1)
    alone = [tilts(flat_descent(seed), solved(flat_descent(seed))) for seed in range(40)]
    assert np.sqrt(np.mean(np.square(alone))) > 1.7 * rms


def test_rotation_that_is_right_leaves_the_windows_own_noise() -> None:
    """Of about 1.5 degrees RMS, which a descent over level ground leaves alone, about 0.4 remain."""
    alone, helped = [], []
    for seed in seeds(60, 20):
        scene = flat_descent(seed)
        alone.append(normal_angle(solved(scene).scaled_normals, scene.normals))
        known = MotionPrior.checked(scene.R, 0.1 * DEG)
        helped.append(normal_angle(solved(scene, known).scaled_normals, scene.normals))
    assert np.sqrt(np.mean(np.square(alone))) > 1.4 * DEG
    assert np.sqrt(np.mean(np.square(helped))) < 0.48 * DEG


def test_covariance_with_a_prior_is_that_of_the_errors() -> None:
    """Squared errors in sigmas of 100 scenes have mean 1 within 15 %, the whole motion in them."""
    normalised = []
    for seed in seeds(100, 50):
        scene = flat_descent(seed, 20.0)
        found = solved(scene, measured(scene, seed, 0.1 * DEG, 0.5 * DEG))
        off = np.append(rotation_vector(found.R @ scene.R.T), found.tangent.T @ (found.T - scene.T))
        normalised.append(off @ np.linalg.solve(found.motion_covariance, off) / 5)
    assert np.mean(normalised) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("known", ["rotation", "direction"])
def test_a_prior_decides_between_two_answers(known: str) -> None:
    undecided = [seed for seed in range(12) if solved(flat_descent(seed, 45.0)).ambiguity.status == "unresolved"]
    assert len(undecided) >= 8
    for seed in undecided:
        scene = flat_descent(seed, 45.0)
        prior = measured(scene, seed, **{f"{known}_sigma": 1.0 * DEG})
        found = solved(scene, prior)
        assert found.ambiguity.status != "unresolved"
        assert np.abs(tilts(scene, found)).max() < 2 * DEG


@pytest.mark.parametrize("sigma_deg", [5.0, 1e-9])
def test_however_sharp_a_prior_the_answer_it_rules_out_is_kept_with_the_margin(sigma_deg: float) -> None:
    """A sharp one leaves no second minimum, but the images alone admit that answer all the same."""
    undecided = [seed for seed in range(8) if solved(flat_descent(seed, 45.0)).ambiguity.status == "unresolved"]
    assert len(undecided) >= 5
    for seed in undecided:
        scene = flat_descent(seed, 45.0)
        found = solved(scene, MotionPrior.checked(direction=scene.T, direction_sigma=sigma_deg * DEG))
        assert found.ambiguity.status == "resolved"
        assert found.ambiguity.alternative is not None
        assert np.abs(tilts(scene, found)).max() < 2 * DEG
        assert np.abs(tilts(scene, found.ambiguity.alternative)).max() > 10 * DEG
        by_prior, in_all = found.ambiguity.delta_chi2_prior, found.ambiguity.delta_chi2
        assert in_all == pytest.approx(by_prior, abs=20.0, rel=1e-9)  # the images are all but neutral
        apart = 2 * np.sin(40.7 / 2 * DEG)  # of the two motions, as test_second_root has it
        assert by_prior == pytest.approx((apart / max(sigma_deg * DEG, 1e-7)) ** 2, rel=0.2)
        assert solved(scene).ambiguity.delta_chi2_prior is None


def test_a_motion_known_exactly_is_kept_and_only_planes_are_solved() -> None:
    scene = make_scene(np.random.default_rng(2), trajectory_deg=30.0)
    found = solved(scene, MotionPrior.checked(scene.R, 1e-9, 3.0 * scene.T, 1e-9))
    assert found.converged
    assert rotation_angle(found.R @ scene.R.T) < 1e-6
    assert np.linalg.norm(found.T - scene.T) < 1e-6
    sigma = np.sqrt(np.einsum("mii->mi", found.normal_covariance))
    assert (np.abs(found.scaled_normals - scene.normals) < 4.5 * sigma).all()
    assert found.motion_covariance.max() < 1e-12


def test_a_vague_prior_changes_nothing() -> None:
    scene = make_scene(np.random.default_rng(3))
    plain, vague = solved(scene), solved(scene, measured(scene, 3, 30.0, 30.0))
    assert vague.scaled_normals == pytest.approx(plain.scaled_normals, abs=1e-6)
    assert vague.normal_covariance == pytest.approx(plain.normal_covariance, rel=1e-3)


def test_with_relief_and_mismatches() -> None:
    rng = np.random.default_rng(4)
    scene = make_scene(rng, trajectory_deg=10.0, slopes_deg=[1.0] * 9, relief=0.01, outliers=0.1, free_points=60)
    prior = measured(scene, 4, 0.05 * DEG)
    found = solved(scene, prior, relief=True)
    assert found.converged
    assert rotation_angle(found.R @ scene.R.T) < 0.2 * DEG
    assert rotation_angle(found.R @ scene.R.T) < rotation_angle(solved(scene, relief=True).R @ scene.R.T)


def test_what_is_no_prior_is_refused() -> None:
    scene = make_scene(np.random.default_rng(1))
    for arguments, words in (
        ({"rotation": np.eye(2), "rotation_sigma": 1.0}, "3x3 rotation"),
        ({"rotation": -np.eye(3), "rotation_sigma": 1.0}, "mirrors"),
        ({"rotation": np.eye(3), "rotation_sigma": 0.0}, "sigma of the rotation .* positive"),
        ({"direction": np.zeros(3), "direction_sigma": 1.0}, "not all zero"),
        ({"direction": np.ones(3), "direction_sigma": -1.0}, "sigma of the direction .* positive"),
    ):
        with pytest.raises(InputError, match=words):
            MotionPrior.checked(**arguments)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="use mle"):
        solved(scene, MotionPrior.checked(scene.R, 0.01), solver="ha")
