"""Correspondences labelled by plane: made-up scenes, invariances, degenerate input, labelled photographs."""

from __future__ import annotations

import os
import runpy
from pathlib import Path

import numpy as np
import pytest

from slopecli.errors import InputError
from slopecli.planes import label_planes

BENCHMARK = runpy.run_path(str(Path(__file__).resolve().parent.parent / "benchmarks" / "planes.py"))
ANGLE = np.radians(2.0)
R = np.array([[np.cos(ANGLE), 0, np.sin(ANGLE)], [0, 1, 0], [-np.sin(ANGLE), 0, np.cos(ANGLE)]])
T = np.array([1.0, 0.2, 0.1])
K = np.array([[800.0, 0, 400], [0, 800, 300], [0, 0, 1]])
NORMALS = np.array([[0.0, -0.05, 0.125], [0.09, 0.0, 0.09], [0.0, 0.0, 0.17]])
BOXES = ((0, 380, 800, 220), (450, 20, 330, 330), (20, 20, 330, 330))


def scene(n_outliers: int = 60, noise: float = 0.3, seed: int = 0, per_plane: int = 70) -> tuple[np.ndarray, ...]:
    """uv1, uv2 (n, 2) and true labels (n,), -1 for outliers, shuffled."""
    rng = np.random.default_rng(seed)
    uv1, uv2, truth = [], [], []
    for k, (normal, (x, y, w, h)) in enumerate(zip(NORMALS, BOXES, strict=True)):
        points = rng.uniform([x, y], [x + w, y + h], (per_plane, 2))
        H = K @ R @ (np.eye(3) - np.outer(T, normal)) @ np.linalg.inv(K)
        moved = np.column_stack([points, np.ones(per_plane)]) @ H.T
        uv1.append(points)
        uv2.append(moved[:, :2] / moved[:, 2:] + noise * rng.standard_normal((per_plane, 2)))
        truth.append(np.full(per_plane, k))
    uv1.append(rng.uniform([0, 0], [800, 600], (n_outliers, 2)))
    uv2.append(rng.uniform([0, 0], [800, 600], (n_outliers, 2)))
    truth.append(np.full(n_outliers, -1))
    order = rng.permutation(sum(map(len, truth)))
    return tuple(np.concatenate(part)[order] for part in (uv1, uv2, truth))


def agreement(truth: np.ndarray, labels: np.ndarray) -> float:
    """Share of points whose plane is the one most of their true plane got; outliers must be -1."""
    right = (labels[truth == -1] == -1).sum()
    for k in range(truth.max() + 1):
        own = labels[truth == k]
        right += np.bincount(own[own >= 0], minlength=1).max()
    return float(right / len(truth))


@pytest.mark.parametrize("n_outliers", [10, 60, 200])
def test_planes_and_outliers_are_told_apart(n_outliers: int) -> None:
    uv1, uv2, truth = scene(n_outliers)
    labels = label_planes(uv1, uv2)
    assert labels.max() == 2
    assert agreement(truth, labels) > 0.95


@pytest.mark.parametrize("noise", [0.5, 1.5])
def test_the_noise_is_found_out(noise: float) -> None:
    uv1, uv2, truth = scene(noise=noise)
    labels = label_planes(uv1, uv2)
    assert labels.max() == 2
    assert agreement(truth, labels) > 0.93


def test_labels_run_from_the_largest_plane() -> None:
    labels = label_planes(*scene()[:2])
    sizes = np.bincount(labels[labels >= 0])
    assert (np.diff(sizes) <= 0).all()


def test_the_same_seed_gives_the_same_labels_in_any_order() -> None:
    uv1, uv2, _ = scene()
    labels = label_planes(uv1, uv2, seed=3)
    order = np.random.default_rng(1).permutation(len(uv1))
    assert np.array_equal(label_planes(uv1, uv2, seed=3), labels)
    assert np.array_equal(label_planes(uv1[order], uv2[order], seed=3), labels[order])


def test_turning_and_scaling_the_images_changes_hardly_a_label() -> None:
    uv1, uv2, _ = scene()
    turn = 1.7 * np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    labels, turned = label_planes(uv1, uv2), label_planes(uv1 @ turn.T + 50, uv2 @ turn.T - 20)
    assert agreement(labels, turned) > 0.97


def test_one_plane_in_two_pieces_is_one() -> None:
    uv1, uv2, truth = scene(20)
    aside = (truth == 0) & (np.abs(uv1[:, 0] - 400) < 150)
    labels = label_planes(uv1[~aside], uv2[~aside])
    assert len(np.unique(labels[(truth[~aside] == 0) & (labels >= 0)])) == 1


def test_many_matches_are_labelled_as_few_are() -> None:
    uv1, uv2, truth = scene(400, per_plane=500)
    labels = label_planes(uv1, uv2)
    assert labels.max() == 2
    assert agreement(truth, labels) > 0.95


def test_chance_is_no_plane() -> None:
    rng = np.random.default_rng(0)
    labels = label_planes(rng.uniform(0, 600, (120, 2)), rng.uniform(0, 600, (120, 2)))
    assert (labels == -1).all()


@pytest.mark.parametrize("n", [0, 1, 4])
def test_too_few_matches_show_no_plane(n: int) -> None:
    points = np.random.default_rng(0).uniform(0, 600, (n, 2))
    assert label_planes(points, points + 5).tolist() == [-1] * n


def test_the_same_match_given_twice_gets_one_label() -> None:
    uv1, uv2, _ = scene()
    labels = label_planes(np.vstack([uv1, uv1]), np.vstack([uv2, uv2]))
    assert np.array_equal(labels[: len(uv1)], labels[len(uv1) :])


def test_points_on_a_line_do_not_crash() -> None:
    line = np.column_stack([np.linspace(0, 500, 40), np.linspace(0, 300, 40)])
    assert len(label_planes(line, line + np.array([10.0, 2.0]))) == 40


def test_bad_input_is_named() -> None:
    with pytest.raises(InputError, match="same shape"):
        label_planes(np.zeros((5, 2)), np.zeros((4, 2)))
    with pytest.raises(InputError, match="not finite"):
        label_planes(np.full((9, 2), np.nan), np.zeros((9, 2)))
    with pytest.raises(InputError, match="sigma_px"):
        label_planes(np.ones((9, 2)), np.ones((9, 2)), sigma_px=0.0)


@pytest.mark.slow
@pytest.mark.skipif("SLOPEMAP_DATA" not in os.environ, reason="SLOPEMAP_DATA names no folder of image pairs")
def test_labelled_photographs() -> None:
    files = sorted(Path(os.environ["SLOPEMAP_DATA"]).glob("real/adelaide-rmf-h/*_matches.csv"))
    wrong = np.array([[BENCHMARK["misclassified"](path, seed)[0] for path in files] for seed in range(2)])
    assert len(files) == 12
    assert (wrong.mean(axis=1) < 0.045).all()
    assert (np.median(wrong, axis=1) < 0.025).all()
