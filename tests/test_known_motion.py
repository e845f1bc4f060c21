"""What a user knows of the motion: read from files and flags, used, and left out where the images contradict it."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command import slopemap

from slopecli.errors import InputError
from slopecli.findings import motion_prior, rotation_of_quaternion
from slopecli.geometry import rotation_from_vector, rotation_vector
from slopecli.io import load_pose
from slopecli.options import Options, Pose
from slopecli.patches import Given
from slopecli.pipeline import solve
from slopecli.study import make_scene

DESCENT = Path(__file__).resolve().parent.parent / "sample_data" / "descent"
TRUTH = json.loads((DESCENT / "truth.json").read_text())
R, T = np.array(TRUTH["R"]), np.array(TRUTH["T"])
PAIR = (str(DESCENT / "image1.png"), str(DESCENT / "image2.png"), "--camera", str(DESCENT / "camera.json"))


@cache
def answer(*arguments: str) -> tuple[dict[str, Any], str]:
    """The content of slopes.json, to be read only, and what was said on stderr."""
    done = slopemap("estimate", *PAIR, "--json", *arguments)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


def write(path: Path, values: object) -> str:
    path.write_text(json.dumps(values))
    return str(path)


# ---- files and numbers ----


def test_both_conventions_of_a_position_are_read(tmp_path: Path) -> None:
    ours = load_pose(write(tmp_path / "a.json", {"R": R.tolist(), "T": T.tolist()}))
    opencv = load_pose(write(tmp_path / "b.json", {"R": R.tolist(), "t": (-R @ T).tolist()}))
    column = load_pose(write(tmp_path / "d.json", {"R": R.tolist(), "t": (-R @ T)[:, None].tolist()}))
    both = load_pose(write(tmp_path / "e.json", {"R": R.tolist(), "T": T.tolist(), "t": (-R @ T).tolist()}))
    motion = {"rotation_cam2_from_cam1": R.tolist(), "baseline_cam1": T.tolist()}
    answered = {"motion": motion, "scale": {"unit": "m", "source": "pose", "sigma": 0.0}}
    for pose in (ours, opencv, column, both, load_pose(write(tmp_path / "c.json", answered))):
        assert np.array(pose.rotation).reshape(3, 3) == pytest.approx(R, abs=1e-6)
        assert pose.baseline_m == pytest.approx(tuple(T), abs=1e-9)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([], "no object"),
        ({"T": [0, 0, 1]}, "has no 'R'"),
        ({"R": np.eye(3).tolist()}, "has no 'T'"),
        ({"R": np.eye(2).tolist(), "T": [0, 0, 1]}, "'R' is not 3 x 3"),
        ({"R": (2 * np.eye(3)).tolist(), "T": [0, 0, 1]}, "no rotation"),
        ({"R": (-np.eye(3)).tolist(), "T": [0, 0, 1]}, "no rotation"),
        ({"R": np.eye(3).tolist(), "T": [0, 0, 0]}, "T is zero"),
        ({"R": np.eye(3).tolist(), "T": [0, "up", 0]}, "'T' is not 3"),
        ({"R": np.eye(3).tolist(), "T": [[0, 1, 0]]}, "'T' is not 3"),
        ({"R": np.eye(3).tolist(), "T": [0, 1, 0], "t": [0, 1, 0]}, "'T' and 't' contradict each other"),
        ({"R": np.eye(3).tolist(), "T": [1e300, 1e300, 1e300]}, "its T is .* m long"),
        ({"R": np.eye(3).tolist(), "T": [1e-320, 0, 0]}, "its T is .* m long"),
        ({"R": np.eye(3).tolist(), "t": [1e308, -1e308, 1e308]}, "its T is .* m long"),
        ({"R": np.eye(3).tolist(), "T": [0, 0, 10**400]}, "'T' is not 3 finite numbers"),
        ({"R": np.diag([1e308, 1e308, 1e308]).tolist(), "T": [0, 0, 1]}, "no rotation"),
        ({"motion": {}, "scale": {"unit": "baseline"}}, "in baselines, not metres"),
    ],
)
def test_what_is_no_pose_is_refused(tmp_path: Path, values: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        load_pose(write(tmp_path / "pose.json", values))


def test_a_key_that_stands_twice_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "pose.json"
    path.write_text('{"R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "T": [0, 0, 1], "T": [0, 0, 9]}')
    with pytest.raises(InputError, match="has 'T' twice"):
        load_pose(path)


def test_a_pose_that_cannot_be_read_is_one_line_and_no_file(tmp_path: Path) -> None:
    (tmp_path / "text.json").write_text("x,y,z\n")
    for file, words in (("none.json", "no such pose file"), ("text.json", "is not JSON")):
        done = slopemap("estimate", *PAIR, "--pose", str(tmp_path / file), "-o", str(tmp_path / "out"))
        assert done.returncode == 1
        assert words in done.stderr
        assert len(done.stderr.splitlines()) == 1
        assert not (tmp_path / "out").exists()


def test_quaternions_are_rotations() -> None:
    w = np.array([0.3, -0.2, 0.5])
    angle = float(np.linalg.norm(w))
    q = np.append(np.cos(angle / 2), np.sin(angle / 2) * w / angle)
    assert rotation_of_quaternion(7 * q) == pytest.approx(rotation_from_vector(w), abs=1e-12)


def test_a_prior_that_excludes_nothing_is_refused() -> None:
    for useless in (
        Options(direction_prior=(0, 0, 1, 180.0)),
        Options(rotation_prior=(1, 0, 0, 0, np.inf)),
        Options(rotation_prior=(0, 0, 0, 0, 1.0)),
    ):
        with pytest.raises(InputError, match=r"excludes nothing|has no direction"):
            motion_prior(useless)


def test_a_direction_of_any_length_is_one() -> None:
    for length in (1e-200, 1.0, 1e200):
        prior = motion_prior(Options(direction_prior=(length, length, 0, 1), rotation_prior=(0, length, 0, 0, 1)))
        assert prior is not None
        assert prior.direction == pytest.approx([0.5**0.5, 0.5**0.5, 0])
        assert prior.rotation == pytest.approx(np.diag([1, -1, -1]))


def test_sigmas_are_degrees() -> None:
    prior = motion_prior(Options(rotation_prior=(1, 0, 0, 0, 0.5), direction_prior=(0, 0, 2, 3)))
    assert prior is not None
    assert (prior.rotation_sigma, prior.direction_sigma) == pytest.approx(np.radians((0.5, 3)))
    assert motion_prior(Options()) is None


# ---- the command ----


def test_a_pose_gives_metres_and_is_the_motion_of_the_answer(tmp_path: Path) -> None:
    pose = write(tmp_path / "pose.json", {"R": R.tolist(), "T": T.tolist()})
    result, _ = answer("--pose", pose)
    assert result["scale"] == {"unit": "m", "source": "pose", "sigma": 0.0}
    assert result["motion"]["baseline_cam1"] == pytest.approx(T, abs=1e-4 * np.linalg.norm(T))
    assert result["motion"]["rotation_cam2_from_cam1"] == pytest.approx(R, abs=1e-5)
    assert result["motion"]["rotation_sigma_deg"] < 1e-3
    assert result["options"]["pose"]["baseline_m"] == pytest.approx(T)


def test_a_pose_of_a_sensor_has_a_sigma_and_is_not_thrown_out() -> None:
    """0.3 deg off about each axis, as of an inertial sensor: it is contradicted if called exact, else it helps."""
    scene = make_scene(np.random.default_rng(1), noise_px=0.3, slopes_deg=[0.0] * 9, height_spread=0.0)
    off = rotation_from_vector(np.radians([0.3, -0.3, 0.3]))
    pose = Pose(tuple((off @ scene.R).ravel()), tuple(12.5 * (off @ scene.T)))
    given, cameras = Given(scene.uv1, scene.uv2, scene.patch), (scene.camera, scene.camera)
    plain, exact, known = (
        solve(given, cameras, options)
        for options in (Options(baseline_m=12.5), Options(pose=pose), Options(pose=pose, pose_sigma_deg=0.3))
    )
    (warning,) = (one for one in exact.diagnostics if one.code == "prior-contradicted")
    assert "the pose given" in warning.message
    assert "lengths still rest on its distance" in warning.message
    assert "--pose-sigma" in (warning.remedy or "")
    assert "prior-contradicted" not in {one.code for one in known.diagnostics}
    assert known.scale == exact.scale
    assert np.linalg.norm(known.motion.baseline_cam1) == pytest.approx(12.5)
    assert (plain.ambiguity.status, known.ambiguity.status != "unresolved") == ("unresolved", True)
    for before, after in zip(plain.planes, known.planes, strict=True):
        assert after.slope_sigma_deg < 1.05 * before.slope_sigma_deg
        assert after.slope_deg < 4 * after.slope_sigma_deg


def test_a_rotation_vector_and_its_quaternion_are_the_same_prior() -> None:
    vector, _ = answer("--rotation-prior", "5,5,5,0.1")
    half = np.radians(5.0 * np.sqrt(3.0)) / 2.0
    part = float(np.sin(half) / np.sqrt(3.0))
    quaternion, _ = answer("--rotation-prior", f"{float(np.cos(half))!r},{part!r},{part!r},{part!r},0.1")
    assert vector["options"]["rotation_prior"] == pytest.approx(quaternion["options"]["rotation_prior"], abs=1e-12)


def test_a_prior_is_worth_its_sigma() -> None:
    plain, _ = answer()
    axis = ",".join(str(v) for v in T)
    known, _ = answer("--direction-prior", f"{axis},0.001")
    assert known["motion"]["direction_sigma_deg"] <= 0.0011 < plain["motion"]["direction_sigma_deg"]
    assert not [one for one in known["diagnostics"] if one["code"] == "prior-contradicted"]
    for before, after in zip(plain["planes"], known["planes"], strict=True):
        # the noise of a window's pixels is measured with either motion: 0.013 deg to a fifth
        assert after["slope_sigma_deg"] <= before["slope_sigma_deg"] * 1.05 + 0.003
        assert abs(after["slope_deg"] - before["slope_deg"]) < 3 * before["slope_sigma_deg"] + 0.05


def test_what_the_images_contradict_is_left_out_and_said() -> None:
    plain, _ = answer()
    wrong, talk = answer("--rotation-prior", "5,5,5,0.1")
    (warning,) = (one for one in wrong["diagnostics"] if one["code"] == "prior-contradicted")
    assert warning["severity"] == "warning"
    assert warning["value"] > 16.3
    assert "contradict the rotation given, so it was left out" in talk
    assert wrong["planes"] == plain["planes"]


def test_what_lenses_may_feign_widens_the_sigmas() -> None:
    """A rotation hardly wrong, known to a thousandth of a degree: it is used, and nothing gets surer than without."""
    plain, _ = answer()
    vector = np.degrees(rotation_vector(R)) + 0.008
    known, talk = answer("--rotation-prior", ",".join(str(v) for v in [*vector, 0.001]))
    (note,) = (one for one in known["diagnostics"] if one["code"] == "prior-contradicted")
    assert note["severity"] == "info"
    assert "sigmas of matches" in talk
    for before, after in zip(plain["planes"], known["planes"], strict=True):
        assert after["slope_sigma_deg"] > before["slope_sigma_deg"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--rotation-prior", "0,0,1"), "QW,QX,QY,QZ,SIGMA"),
        (("--rotation-prior", "0,0,1,0"), "SIGMA must be > 0"),
        (("--rotation-prior", "0,0,1,180"), "SIGMA must be > 0 and < 90 deg"),
        (("--rotation-prior", "1,0,0,0,1e300"), "SIGMA must be > 0 and < 90 deg"),
        (("--rotation-prior", "1e308,0,0,1"), "angle must be at most 360 deg"),
        (("--direction-prior", "0,0,1,90"), "SIGMA must be > 0 and < 90 deg"),
        (("--rotation-prior", "0,0,0,0,1"), "must not be zero"),
        (("--direction-prior", "0,0,0,1"), "must not be zero"),
        (("--direction-prior", "0,0,1,0.5", "--solver", "ha"), "--direction-prior is for --solver mle"),
        (("--pose", "x.json", "--baseline", "2"), "contradict each other"),
        (("--pose-sigma", "0.3"), "--pose-sigma is of a --pose"),
        (("--pose", "x.json", "--pose-sigma", "90"), "0<x<90"),
        (("--pose", "x.json", "--rotation-prior", "0,0,1,1"), "contradict each other"),
    ],
)
def test_usage(arguments: tuple[str, ...], words: str) -> None:
    done = slopemap("estimate", *PAIR, "--json", *arguments)
    assert done.returncode == 2
    assert words in done.stderr


# ---- planes that are one ----


def test_merging_is_asked_for_and_said() -> None:
    plain, _ = answer()
    assert not [one for one in plain["diagnostics"] if one["code"] == "coplanar"]
    merged, talk = answer("--merge-coplanar", "--grid", "4x4")
    assert merged["options"]["merge_coplanar"] is True
    for note in (one for one in merged["diagnostics"] if one["code"] == "coplanar"):
        ids = [int(i) for i in note["message"].partition(" lie ")[0].partition(" face ")[0].split(", ")]
        facing = [plane["normal_cam1"] for plane in merged["planes"] if plane["id"] in ids]
        assert len(facing) >= 2
        assert np.ptp(facing, axis=0).max() < 1e-6
        assert note["value"] >= 1
        assert note["message"] in talk
    done = slopemap("estimate", *PAIR, "--json", "--merge-coplanar", "--solver", "ha")
    assert done.returncode == 2
    assert "--merge-coplanar is for --solver mle" in done.stderr


def test_a_platform_in_pieces_is_one_plane_and_better_known(tmp_path: Path) -> None:
    """Windows on the street of the sample town, clear of cars, which is one plane."""
    urban = DESCENT.parent / "urban"
    truth = json.loads((urban / "truth.json").read_text())
    pair = (str(urban / "image1.png"), str(urban / "image2.png"), "--camera", str(urban / "camera.json"))
    windows = [part for x, y in ((260, 330), (330, 400), (400, 356)) for part in ("--window", f"{x},{y},60,60")]
    up = ("--up", ",".join(map(str, truth["up_cam1"])))
    results = []
    for flag in ((), ("--merge-coplanar",)):
        done = slopemap("estimate", *pair, *windows, *up, "--json", *flag)
        assert done.returncode == 0, done.stderr
        results.append(json.loads(done.stdout))
    (note,) = (one for one in results[1]["diagnostics"] if one["code"] == "coplanar")
    assert note["message"].startswith("1, 2, 3 lie on one plane")
    for before, after in zip(results[0]["planes"], results[1]["planes"], strict=True):
        assert after["slope_deg"] < 1
        assert after["slope_sigma_deg"] < before["slope_sigma_deg"]
    assert note["value"] > 1.2  # times better, the median window
