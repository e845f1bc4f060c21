"""One bad patch does not spoil the others: it is set aside by name, and they are solved as if it had not been given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from campaign import seeds
from scenery import make_camera, render, tilted, turn, unit

from slopecli.geometry import homogeneous
from slopecli.look import Scene
from slopecli.options import Options
from slopecli.patches import PLANE_FINDERS, Found, Given
from slopecli.pipeline import estimate, solve
from slopecli.study import make_scene, project
from slopecli.types import FloatArray, Image, Report

FLOORS_DEG = [5.0, 8.0, 3.0, 6.0]  # the last one is spoilt


def spoilt(kind: str, seed: int, points: int = 30) -> tuple[Report, FloatArray]:
    """The report of three floors and a fourth patch whose rows are no plane of the scene, and the true slopes, deg."""
    scene = make_scene(np.random.default_rng(seed), grid=(2, 2), points=points, slopes_deg=FLOORS_DEG)
    rng, focal = np.random.default_rng(seed + 100), scene.camera.focal_px
    bad = np.flatnonzero(scene.patch == 3)
    x1, x2, patch = scene.x1.copy(), scene.x2.copy(), scene.patch.copy()
    noise = 0.3 / focal * rng.standard_normal((len(bad), 2))
    inverse_depth = homogeneous(x1[bad]) @ scene.normals[3]
    if kind == "mismatched":
        x2[bad] = rng.uniform(-0.5, 0.5, x2[bad].shape)
    elif kind == "permuted":
        x2[bad] = x2[rng.permutation(bad)]
    elif kind == "at infinity":
        x2[bad] = project(scene.R, scene.T, x1[bad], 0.0 * inverse_depth) + noise
    elif kind == "behind":
        x2[bad] = project(scene.R, scene.T, x1[bad], -inverse_depth) + noise
    elif kind == "moved":
        x2[bad] += np.array([90.0, -70.0]) / focal
    elif kind == "one point":
        x2[bad] = x2[bad].mean(axis=0)
    elif kind == "on a line":
        x1[bad] = x1[bad[0]] + np.outer(np.linspace(0, 0.3, len(bad)), [1.0, 0.3])
        x1[bad] += 1e-5 * rng.standard_normal((len(bad), 2))
        x2[bad] = project(scene.R, scene.T, x1[bad], homogeneous(x1[bad]) @ scene.normals[3]) + noise
    elif kind == "three rows":
        x2[bad] = rng.uniform(-0.5, 0.5, x2[bad].shape)
        patch[bad[3:]] = -1
        x2[bad[3:]] = scene.x2[bad[3:]]
    uv1, uv2 = (x * focal + [scene.camera.cx, scene.camera.cy] for x in (x1, x2))
    return solve(Given(uv1, uv2, patch), (scene.camera, scene.camera), Options()), np.degrees(scene.slopes)


KINDS = ("mismatched", "permuted", "at infinity", "behind", "moved", "one point", "on a line", "three rows")


@pytest.mark.parametrize("kind", KINDS)
def test_three_floors_are_solved_beside_a_bad_patch(kind: str) -> None:
    for seed in seeds(12, 1):
        report, true = spoilt(kind, seed)
        floors = [plane for plane in report.planes if plane.id < 3]
        assert [plane.status for plane in floors] == ["ok"] * 3
        assert [plane.verdict for plane in floors] == ["safe"] * 3
        for plane in floors:
            assert abs(plane.slope_deg - true[plane.id]) < 4 * plane.slope_sigma_deg + 0.1
        # the bad one is named, and nothing of it is stated surely
        others = [plane for plane in report.planes if plane.id == 3]
        assert len(others) + len(report.rejected) == 1
        assert not any(plane.status == "ok" for plane in others)
        assert {one.reason for one in report.rejected} <= {"unsettled", "slope-open", "too-few-points"}


def test_a_bad_patch_is_named_with_its_reason() -> None:
    report, _ = spoilt("mismatched", 0)
    (bad,) = report.rejected
    assert (bad.id, bad.reason) == (3, "unsettled")
    assert "the joint solution does not settle with it" in bad.message
    moved, _ = spoilt("moved", 0)
    assert "the motion that the others agree on" in moved.rejected[0].message


def test_nobody_is_blamed_where_two_patches_contradict_each_other() -> None:
    """With two, nothing tells which of them moved; and right ones are never set aside."""
    scene = make_scene(np.random.default_rng(0), grid=(2, 1), slopes_deg=[5.0, 8.0])
    x2 = scene.x2 + (scene.patch == 1)[:, None] * np.array([0.1, -0.08])
    for rows in (x2, scene.x2):
        report = solve(Given(scene.x1, rows, scene.patch), None, Options())
        assert not report.rejected
    for seed in seeds(200, 6):
        scene = make_scene(np.random.default_rng(seed), points=8, grid=(2, 2))
        report = solve(Given(scene.uv1, scene.uv2, scene.patch), (scene.camera, scene.camera), Options())
        assert "unsettled" not in {one.reason for one in report.rejected}


def test_windows_of_images_are_solved_beside_a_bad_one(monkeypatch: pytest.MonkeyPatch) -> None:
    pair = render(turn(1.0, -1.0, 2.0), unit(0.7, 0.1, 0.7), [tilted(0.05, 0.1, 5.0)], noise=1.0)

    windows = PLANE_FINDERS["windows"]

    def find(scene: Scene, options: Options) -> Found:
        """The last window is matched to what would be behind the camera."""
        found = windows(scene, options)
        *good, last = found.patches
        x1 = last.matches.x1
        x2 = project(scene.R, scene.T, x1, -0.1 - 0.02 * homogeneous(x1) @ np.array([1.0, 2.0, 1.0]))
        bad = replace(last, matches=replace(last.matches, x2=x2, uv2=scene.pixels2(x2)))
        return found._replace(patches=[*good, bad])

    monkeypatch.setitem(PLANE_FINDERS, "windows", find)
    camera = make_camera()
    report = estimate(Image(pair.grey1), Image(pair.grey2), camera, camera, Options(grid=(2, 2)))
    assert [(one.id, one.reason) for one in report.rejected] == [(4, "unsettled")]
    assert all("converge" not in (plane.reason or "") for plane in report.planes)
    assert report.fit.converged


@pytest.mark.parametrize(("moved", "seed"), [(2, 1), (3, 0), (3, 2)])
def test_patches_that_contradict_one_another_are_said(moved: int, seed: int) -> None:
    """Of six patches each is a plane, but two or three of them moved, each otherwise; one alone is not to blame."""
    scene = make_scene(np.random.default_rng(seed), grid=(2, 3), points=30, slopes_deg=[5.0, 8, 3, 6, 12, 9])
    rng, focal, x2 = np.random.default_rng(seed + 50), scene.camera.focal_px, scene.x2.copy()
    for k in range(moved):
        x2[scene.patch == k] += rng.uniform(-1.0, 1.0, 2) * 60.0 / focal
    uv1, uv2 = (x * focal + [scene.camera.cx, scene.camera.cy] for x in (scene.x1, x2))
    report = solve(Given(uv1, uv2, scene.patch), (scene.camera, scene.camera), Options())
    said = [d.message for d in report.diagnostics if d.code == "planes-contradict"]
    assert any("contradict one another, and no single one is to blame" in message for message in said)
    assert all(message.endswith("; no verdict is safe") for message in said)
    assert not any(plane.verdict == "safe" for plane in report.planes)


def test_patches_that_are_noisy_alone_do_not_contradict_one_another() -> None:
    scene = make_scene(np.random.default_rng(1), grid=(2, 3), points=30, slopes_deg=[5.0, 8, 3, 6, 12, 9])
    x2 = scene.x2 + 3.0 / scene.camera.focal_px * np.random.default_rng(2).standard_normal(scene.x2.shape)
    uv1, uv2 = (x * scene.camera.focal_px + [scene.camera.cx, scene.camera.cy] for x in (scene.x1, x2))
    report = solve(Given(uv1, uv2, scene.patch), (scene.camera, scene.camera), Options())
    said = [d.message for d in report.diagnostics if d.code == "poor-fit"]
    assert said
    assert not any("contradict" in message for message in said)
