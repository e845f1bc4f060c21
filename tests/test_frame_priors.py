"""What other sensors tell of the frames of a sequence: up, north, metres, which of two motions, and files refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command import slopemap
from frames import CAMERA, GRID, NORMALS, STEP, frame, write_frames
from scenery import render, turn

from slopecli.errors import InputError
from slopecli.geometry import forward_angles_deg
from slopecli.io import FrameSource, read_priors, with_frame_priors
from slopecli.options import Options
from slopecli.sequence import Frame, FramePrior, Sequence
from slopecli.types import FloatArray

COUNT, METRES = 4, 2.5  # frames, and of a step
UP = np.array([0.1, -0.05, -1.0]) / np.linalg.norm([0.1, -0.05, -1.0])
NORTH = np.cross(UP, [1.0, 0.0, 0.0]) / np.linalg.norm(np.cross(UP, [1.0, 0.0, 0.0]))
NED1 = np.stack([NORTH, np.cross(-UP, NORTH), -UP])  # from axes of camera 1


def turned(number: int) -> FloatArray:
    """Rotation from camera 1 to that of a frame of `frames.frame`."""
    return turn(0.3 * np.sin(number), 0.4 * np.sin(0.7 * number), 0.5 * number) if number else np.eye(3)


def ground_m() -> float:
    """Median height of frame 1 above the ground of the windows."""
    u, v = np.meshgrid(np.arange(8, CAMERA.width, 8), np.arange(8, CAMERA.height, 8))
    x = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones(u.shape)])
    face = (u >= CAMERA.width // 2) + 2 * (v >= CAMERA.height // 2)
    P = x / (NORMALS[face].transpose(2, 0, 1) * x).sum(axis=0)
    return float(np.median(-np.einsum("c,chw->hw", UP, P)))


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight")
    write_frames(folder, COUNT)
    return folder


def rows(signs: float = 1.0) -> list[str]:
    """Lines of a file of priors: angles and altitudes of all frames, true but for the signs of roll."""
    lines = ["frame,altitude_m,altitude_sigma_m,yaw_deg,pitch_deg,roll_deg,attitude_sigma_deg"]
    for number in range(COUNT):
        yaw, pitch, roll = forward_angles_deg(NED1 @ turned(number).T)
        height = METRES * (ground_m() + float(UP @ STEP) * number)
        lines.append(f"{number + 1},{height:.4f},0.5,{yaw:.4f},{pitch:.4f},{signs * roll:.4f},0.2")
    return lines


def ran(flight: Path, out: Path, lines: list[str], *more: str) -> tuple[int, str]:
    """Exit status and what was said of a run with a file of priors."""
    path = out / "priors.csv"
    path.write_text("\n".join(lines) + "\n")
    camera = str(flight / "camera.json")
    done = slopemap(
        "sequence", str(flight), "--glob", "*.png", "--camera", camera, "--grid", GRID, "-o", str(out / "answer"),
        "--priors", str(path), *more,
    )  # fmt: skip
    return done.returncode, done.stderr


def test_angles_give_up_and_north_and_altitudes_metres(flight: Path, tmp_path: Path) -> None:
    status, said = ran(flight, tmp_path, rows())
    assert status == 0, said
    document = json.loads((tmp_path / "answer" / "slopes.json").read_text())
    assert np.degrees(np.arccos(np.dot(document["up"]["vector_cam1"], UP))) < 0.05
    assert (document["up"]["source"], document["up"]["sigma_deg"]) == ("given", 0.2)
    assert (document["scale"]["unit"], document["scale"]["source"]) == ("m", "altitude")
    first = np.linalg.norm(document["motions"][1]["motion"]["baseline_cam1"])
    assert first == pytest.approx(METRES, rel=0.005)
    # that of the altitude that is known best, as errors of a sensor repeat
    assert document["scale"]["sigma"] == pytest.approx(0.5 / (METRES * ground_m()), rel=0.01)
    n = -NORMALS / np.linalg.norm(NORMALS, axis=1, keepdims=True)
    slopes = [plane["slope_deg"] for plane in document["planes"]]
    np.testing.assert_allclose(slopes, np.degrees(np.arccos(n @ UP)), atol=0.3)
    downhill = n - (n @ UP)[:, None] * UP
    aspect = np.degrees(np.arctan2(downhill @ NED1[1], downhill @ NORTH)) % 360.0
    off = [(plane["aspect_deg"] - true + 180.0) % 360.0 - 180.0 for plane, true in zip(document["planes"], aspect)]
    assert np.abs(off[1]) < 2.0  # the steepest
    assert "metadata-contradicted" not in {one["code"] for one in document["diagnostics"]}


def test_angles_that_the_images_contradict_are_warned_of(flight: Path, tmp_path: Path) -> None:
    lines = rows()
    lines[3] = lines[3].replace(lines[3].split(",")[3], f"{float(lines[3].split(',')[3]) + 20.0:.4f}", 1)
    status, said = ran(flight, tmp_path, lines)
    assert status == 0, said
    assert "metadata-contradicted: frame 3 is turned against the first by 20°" in said


def test_lengths_and_angles_are_not_given_twice(flight: Path, tmp_path: Path) -> None:
    for more, what in (
        (["--altitude", "50"], "--altitude"),
        (["--up", "0,0,-1"], "--up"),
        (["--north", "0,-1,0"], "--north"),
    ):
        status, said = ran(flight, tmp_path, rows(), *more)
        assert status == 2
        assert f"{what} and " in said
    status, said = ran(flight, tmp_path, ["altitude_m", "50", "48"])
    assert status == 1
    assert f"has 2 rows for {COUNT} frames" in said
    status, said = ran(flight, tmp_path, ["frame,altitude_m", "1,50", "12,48"])
    assert (status, f"a row of frame 12, but there are {COUNT}" in said) == (1, True)
    status, said = ran(flight, tmp_path, ["altitude_m", *["50"] * COUNT], "--up", "dominant-plane")
    assert (status, "--up X,Y,Z" in said) == (2, True)
    assert not (tmp_path / "answer" / "slopes.json").exists()


@pytest.mark.parametrize(
    ("wrong", "off", "sigma", "said"),
    [((2,), 0.0, 0.5, "frame 3 in --priors put up 20° off where"), ((1, 2), 10.0, 10.0, "which contradict each other")],
)
def test_ups_that_contradict_each_other_are_said_and_not_trusted(
    wrong: tuple[int, ...], off: float, sigma: float, said: str
) -> None:
    """One of three or two of four is wrong by 20 degrees: it is left out, or the sigma is as large as the dispute."""
    sequence = Sequence(CAMERA, Options(grid=(2, 2)))
    for number in range(2 + len(wrong)):
        ned = turn(0.0, 20.0 if number in wrong else 0.0, 0.0) @ NED1 @ turned(number).T
        sequence.add(frame(number), prior=FramePrior(ned=ned, attitude_sigma_deg=0.5))
    report = sequence.report()
    assert np.degrees(np.arccos(report.up.vector_cam1 @ UP)) == pytest.approx(off, abs=0.1)
    assert report.up.sigma_deg == pytest.approx(sigma, abs=0.1)
    assert said in " ".join(one.message for one in report.diagnostics if one.code == "metadata-contradicted")
    assert all(plane.verdict != "safe" for plane in report.planes)


def test_altitudes_need_an_up_that_is_known() -> None:
    sequence = Sequence(CAMERA, Options(grid=(2, 2), up="dominant-plane"))
    for number in range(2):
        sequence.add(frame(number), prior=FramePrior(altitude_m=50.0))
    with pytest.raises(InputError, match="need an up that is known"):
        sequence.report()


def test_rows_beyond_the_end_of_a_film_of_unknown_length_are_said() -> None:
    said: list[str] = []
    known: dict[int | None, FramePrior] = {1: FramePrior(altitude_m=3.0), 5: FramePrior(altitude_m=4.0)}
    source = FrameSource(Frame("1", None), iter([Frame("2", None), Frame("3", None)]))
    assert [one.prior for one in with_frame_priors(source, "priors.csv", known, said.append)] == [known[1], None, None]
    assert said == ["warning: priors.csv: has a row of frame 5, but there are 3; frames count from 1, in their order"]


def test_known_angles_decide_between_two_answers() -> None:
    """Straight down over one plane two motions are left; they differ in their turn. Without a heading both stay."""
    normal, R = np.array([np.sin(np.radians(15.0)), 0.0, np.cos(np.radians(15.0))]) / 12.0, turn(0.4, 0.2, 0.4)
    pair = render(R, np.array([0.05, 0.02, 1.0]), [normal], noise=1.0)
    for heading, status in ((False, "unresolved"), (True, "none")):
        sequence = Sequence(CAMERA, Options(grid=(2, 2)))
        sequence.add(pair.grey1, prior=FramePrior(ned=NED1, heading=heading, attitude_sigma_deg=0.1))
        sequence.add(pair.grey2, prior=FramePrior(ned=NED1 @ R.T, heading=heading, attitude_sigma_deg=0.1))
        found = sequence.solution()
        assert found.status == status
        if heading:
            n = found.scaled_normals / np.linalg.norm(found.scaled_normals, axis=1, keepdims=True)
            assert np.degrees(np.arccos(n @ normal * 12.0)).max() < 1.0


def test_positions_count_by_their_sigma() -> None:
    """Of two lengths that differ, the answer is near the surer one."""
    sequence = Sequence(CAMERA, Options(grid=(2, 2)))
    for number, (along, sigma) in enumerate([(0.0, 0.1), (2.5, 0.1), (8.0, 50.0)]):
        sequence.add(frame(number), prior=FramePrior((along, 0.0, 0.0), sigma))
    scale = sequence.report().scale
    assert (scale.unit, scale.source) == ("m", "pose")
    first = np.linalg.norm(sequence.motions(sequence.report())[1].motion.baseline_cam1)
    assert first == pytest.approx(2.5, rel=0.01)
    assert scale.sigma == pytest.approx(np.hypot(0.1, 0.1) / 2.5, rel=0.01)


def test_lengths_that_differ_give_no_exact_scale() -> None:
    """Without sigmas nothing but their differences tells how well they are known: 30 % off each other is not exact."""
    sequence = Sequence(CAMERA, Options(grid=(2, 2)))
    for number, along in enumerate([0.0, 2.5, 6.5]):
        sequence.add(frame(number), prior=FramePrior((along, 0.0, 0.0)))
    assert 0.05 < sequence.report().scale.sigma < 0.2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("height\n3\n", "has a column 'height'"),
        ("altitude_m,altitude_m\n3,3\n", "names a column twice"),
        ("altitude_m\n", "no rows"),
        ("altitude_m\nhigh\n", "line 2 has 'high' as altitude_m"),
        ("altitude_m\n-3\n", "a number above 0"),
        ("altitude_m\nnan\n", "line 2 has 'nan'"),
        ("frame,altitude_m\n1,3\n1,4\n", "frame 1 again"),
        ("frame,altitude_m\n0,3\n", "line 2 is of no frame"),
        ("x_m,y_m,z_m\n1,2,\n", "some of x_m, y_m, z_m"),
        ("yaw_deg\n20\n", "some of pitch_deg, roll_deg"),
        ("altitude_m,x_m\n3\n", "line 2 has 1 cells for 2 columns"),
        ("altitude_m,altitude_sigma_m\n3,1\n,1\n", "line 3 has altitude_sigma_m without altitude_m"),
        ("attitude_sigma_deg\n1\n", "line 2 has attitude_sigma_deg without pitch_deg"),
    ],
)
def test_a_file_that_is_no_table_of_priors_is_refused(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "priors.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=str(path)) as problem:
        read_priors(str(path))
    assert said in str(problem.value)
    assert "needed" in str(problem.value)
