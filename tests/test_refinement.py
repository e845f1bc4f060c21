"""The joint least squares: derivatives, invariances, and a zero gradient where it stops."""

from __future__ import annotations

import numpy as np
import pytest

from slopecli.geometry import rotation_from_vector, solve_planes
from slopecli.geometry.solver import State, linearise, normal_equations, observe, optimal_normals, predict, step
from slopecli.study import Scene, make_scene


def perturbed(state: State, w: np.ndarray, dT: np.ndarray, dN: np.ndarray) -> State:
    return State(rotation_from_vector(w)[None] @ state.R, state.T + dT, state.N + dN)


def truth(scene: Scene) -> State:
    return State(scene.R[None], scene.T[None], scene.normals[None])


def scene_and_state(free: int = 30) -> tuple[Scene, State]:
    scene = make_scene(np.random.default_rng(1), grid=(2, 1), points=12, free_points=free, noise_px=0.5)
    rng = np.random.default_rng(2)
    start = perturbed(
        truth(scene), 0.01 * rng.standard_normal(3), 0.02 * rng.standard_normal(3), 0.01 * rng.standard_normal((2, 3))
    )
    return scene, start


def chi2(scene: Scene, state: State) -> float:
    """Straight from the definition, point by point."""
    total = 0.0
    for x1, x2, i in zip(scene.x1, scene.x2, scene.patch, strict=True):
        p = np.append(x1, 1.0)
        if i >= 0:
            y = state.R[0] @ (p - state.T[0] * (state.N[0, i] @ p))
            total += float(np.sum((y[:2] / y[2] - x2) ** 2))
        else:
            line = state.R[0] @ np.cross(state.T[0], p)
            total += float((line @ np.append(x2, 1.0)) ** 2 / (line[:2] @ line[:2]))
    return total


@pytest.mark.parametrize("free", [0, 30])
def test_chi_square_is_the_sum_over_points(free: int) -> None:
    scene, state = scene_and_state(free)
    observations = observe(scene.x1, scene.x2, scene.patch)
    system = normal_equations(state, linearise(observations, predict(observations, *state)))
    assert system.chi2[0] == pytest.approx(chi2(scene, state), rel=1e-10)


def test_gradient_and_information_match_finite_differences() -> None:
    scene, state = scene_and_state()
    observations = observe(scene.x1, scene.x2, scene.patch)
    system = normal_equations(state, linearise(observations, predict(observations, *state)))

    def at(parameters: np.ndarray) -> float:
        return chi2(scene, perturbed(state, parameters[:3], parameters[3:6], parameters[6:].reshape(2, 3)))

    h = 1e-6
    numeric = np.array([(at(h * e) - at(-h * e)) / (2 * h) for e in np.eye(12)])
    # half the gradient of the motion is column 6 before the normals are eliminated; undo the elimination
    V, response = system.plane_block[0], system.response[0]
    normals = (V @ response[:, :, 6:])[:, :, 0]
    motion = system.reduced[0, :6, 6] + np.einsum("mik,mij,mj->k", response[:, :, :6], V, response[:, :, 6])
    assert 2.0 * np.concatenate([motion, normals.ravel()]) == pytest.approx(numeric, rel=1e-5, abs=1e-8)


def test_fixed_form_and_exact_form_agree_where_they_were_taken() -> None:
    scene, state = scene_and_state()
    observations = observe(scene.x1, scene.x2, scene.patch)
    exact = linearise(observations, predict(observations, *state))
    a, b = normal_equations(state, exact), normal_equations(state, exact._replace(centred=False))
    assert a.chi2 == pytest.approx(b.chi2, rel=1e-9)
    assert a.reduced == pytest.approx(b.reduced, rel=1e-6, abs=1e-9)


def test_optimal_normals_are_where_the_step_would_go() -> None:
    scene, state = scene_and_state()
    observations = observe(scene.x1, scene.x2, scene.patch)
    form = linearise(observations, predict(observations, *state))
    best, left = optimal_normals(state.R, state.T, form)
    system = normal_equations(state, form)
    assert pytest.approx(state.N - system.response[..., 6], abs=1e-9) == best.N
    assert left[0] == pytest.approx(system.reduced[0, 6, 6], rel=1e-7)


def test_step_keeps_rotation_and_unit_baseline() -> None:
    scene, state = scene_and_state()
    observations = observe(scene.x1, scene.x2, scene.patch)
    system = normal_equations(state, linearise(observations, predict(observations, *state)))
    moved, promised, *_ = step(state._replace(T=state.T / np.linalg.norm(state.T)), system, np.array([1e-9]))
    assert moved.R[0] @ moved.R[0].T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.norm(moved.T[0]) == pytest.approx(1.0, abs=1e-15)
    assert promised[0] > 0.0


@pytest.mark.parametrize("trajectory", [0.0, 45.0, 90.0])
def test_solution_is_a_minimum(trajectory: float) -> None:
    """A hundredth of a standard error in any direction raises chi-square."""
    scene = make_scene(np.random.default_rng(3), trajectory_deg=trajectory, free_points=20)
    solution = solve_planes(scene.x1, scene.x2, scene.patch, robust=False)
    state = State(solution.R[None], solution.T[None], solution.scaled_normals[None])
    best = chi2(scene, state)
    assert best / solution.noise**2 == pytest.approx(solution.chi2, rel=1e-6)
    sigma = np.sqrt(np.diag(solution.motion_covariance))
    for k in range(5):
        for sign in (-0.01, 0.01):
            move = sign * sigma[k] * np.eye(5)[k]
            dT = solution.tangent @ move[3:]
            dN = np.einsum("mij,j->mi", solution.normal_gain, move)
            T = solution.T + dT
            moved = perturbed(state, move[:3], T / np.linalg.norm(T) - state.T[0], dN)
            assert chi2(scene, moved) > best


def test_order_and_labels_do_not_matter() -> None:
    scene = make_scene(np.random.default_rng(4), free_points=30)
    a = solve_planes(scene.x1, scene.x2, scene.patch)
    shuffle = np.random.default_rng(5).permutation(len(scene.x1))
    relabel = np.append(np.random.default_rng(6).permutation(9), -1)
    b = solve_planes(scene.x1[shuffle], scene.x2[shuffle], relabel[scene.patch[shuffle]])
    # the stopping rule leaves a thousandth of a standard error, a few 1e-7 here
    assert np.abs(a.R - b.R).max() < 1e-7
    assert np.abs(a.scaled_normals - b.scaled_normals[relabel[:9]]).max() < 1e-6
    assert np.array_equal(a.inlier[shuffle], b.inlier)


def test_equal_weights_of_any_size_change_nothing() -> None:
    scene = make_scene(np.random.default_rng(7))
    a = solve_planes(scene.x1, scene.x2, scene.patch)
    b = solve_planes(scene.x1, scene.x2, scene.patch, weights=np.full(270, 4.0))
    assert np.abs(a.R - b.R).max() < 1e-9
    assert b.noise == pytest.approx(2.0 * a.noise)
    assert b.normal_covariance == pytest.approx(a.normal_covariance, rel=1e-6)


def test_weight_zero_is_the_same_as_leaving_out() -> None:
    scene = make_scene(np.random.default_rng(8))
    keep = np.arange(270) % 5 > 0
    x2 = np.where(keep[:, None], scene.x2, scene.x2 + 0.3)
    a = solve_planes(scene.x1[keep], scene.x2[keep], scene.patch[keep])
    b = solve_planes(scene.x1, x2, scene.patch, weights=keep.astype(float))
    assert np.abs(a.R - b.R).max() < 1e-8
    assert b.noise == pytest.approx(a.noise, rel=1e-6)
    assert np.array_equal(b.inlier, keep)


def test_callers_motion_is_tried() -> None:
    scene = make_scene(np.random.default_rng(9))
    a = solve_planes(scene.x1, scene.x2, scene.patch)
    b = solve_planes(scene.x1, scene.x2, scene.patch, initial=[(scene.R, 2.0 * scene.T), (np.eye(3), -scene.T)])
    assert np.abs(a.R - b.R).max() < 1e-7
