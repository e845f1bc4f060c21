"""`sequence --metadata`: what each frame states of gravity, north, focal length and place goes into the answer."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from command import slopemap
from frames import CAMERA, GRID, STEP, frame, true_normals
from metadata_factory import PLACE, gimbal, photograph, xmp_packet
from numpy.testing import assert_allclose
from pyproj import Geod
from scenery import turn
from scipy.spatial.transform import Rotation

BODY = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # x ahead, y right, z down of the camera's x right, y down, z ahead
NED_1 = Rotation.from_euler("ZYX", [130.0, -70.0, 5.0], degrees=True).as_matrix() @ BODY
STEP_M = 2.5
SIGMA_M = 0.05


def tags(number: int, **changes: Any) -> dict[str, Any]:
    """What DJI writes of frame 0, 1, ...; a change of None leaves a value out."""
    R = turn(0.3 * np.sin(number), 0.4 * np.sin(0.7 * number), 0.5 * number)
    yaw, pitch, roll = Rotation.from_matrix(NED_1 @ R.T @ BODY.T).as_euler("ZYX", degrees=True)
    north, east, down = NED_1 @ STEP * STEP_M * number
    azimuth, metres = np.degrees(np.arctan2(east, north)), float(np.hypot(north, east))
    longitude, latitude, _ = Geod(ellps="WGS84").fwd(PLACE[1], PLACE[0], azimuth, metres)
    values = {
        **gimbal(yaw, pitch, roll),
        "GpsLatitude": f"{latitude:.9f}",
        "GpsLongitude": f"{longitude:.9f}",
        "AbsoluteAltitude": f"{412.0 - down:+.3f}",
        "RelativeAltitude": f"{60.0 - down:+.3f}",
        **dict.fromkeys(("RtkStdLat", "RtkStdLon", "RtkStdHgt"), f"{SIGMA_M}"),
        "DewarpData": f"2020-01-01;{CAMERA.fx},{CAMERA.fy},0,0,0,0,0,0,0",
        "DewarpFlag": "0",
        **changes,
    }
    return {name: value for name, value in values.items() if value is not None}


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four frames; the file before the first shows nothing, and states another attitude and place."""
    folder = tmp_path_factory.mktemp("flight")
    black = photograph(np.zeros_like(frame(0)), xmp=xmp_packet(tags(0, **gimbal(10, -20), GpsLatitude="1")))
    (folder / "frame0.jpg").write_bytes(black)
    for number in range(4):
        (folder / f"frame{number + 1}.jpg").write_bytes(photograph(frame(number), xmp=xmp_packet(tags(number))))
    return folder


def asked(folder: Path, *options: str) -> Any:
    return slopemap("sequence", str(folder), "--grid", GRID, "--no-overlay", *options)


def test_slopes_are_against_gravity_and_lengths_in_metres(flight: Path, tmp_path: Path) -> None:
    done = asked(flight, "--metadata", "-o", str(tmp_path))
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "slopes.json").read_text())
    assert "contradict" not in done.stderr
    for plane, normal in zip(document["planes"], true_normals(), strict=True):
        north, east, down = NED_1 @ normal
        assert plane["slope_deg"] == pytest.approx(np.degrees(np.arccos(-down)), abs=plane["slope_sigma_deg"])
        assert plane["aspect_deg"] == pytest.approx(np.degrees(np.arctan2(east, north)) % 360, abs=2)
    assert (document["up"]["source"], document["scale"]["source"]) == ("exif", "exif")
    across = 2**0.5 * SIGMA_M / (3 * STEP_M)  # heights are known half as well
    assert across <= document["scale"]["sigma"] <= 2.0 * across
    moved = [np.array(motion["motion"]["baseline_cam1"]) for motion in document["motions"]]
    assert_allclose([np.linalg.norm(step) for step in moved], STEP_M * np.arange(4), rtol=0.01, atol=1e-9)
    assert document["place"]["position"]["latitude_deg"] == pytest.approx(PLACE[0], abs=1e-9)
    assert (tmp_path / "slopes.geojson").exists()
    assert "from the metadata of the images" in done.stderr


def test_each_by_its_own_word_and_what_is_missing(flight: Path, tmp_path: Path) -> None:
    frames = tmp_path / "frames"
    frames.mkdir()
    for number in range(3):
        bare = xmp_packet(tags(number, GpsLatitude=None, RtkStdLat=None))
        (frames / f"frame{number}.jpg").write_bytes(photograph(frame(number), xmp=bare))
    done = asked(frames, "--camera", "exif", "--up", "exif", "--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert (document["up"]["source"], document["scale"]["unit"]) == ("exif", "baseline")
    done = asked(frames, "--metadata", "--json")
    (missing,) = [one["message"] for one in json.loads(done.stdout)["diagnostics"] if "not in" in one["message"]]
    assert "baseline" in missing
    assert "states no GPS position" in missing
    for words, said in ((["--baseline", "exif"], "states no GPS position"), (["--yaw", "3"], "--pitch")):
        done = asked(frames, "--camera", "exif", *words, "--json")
        assert done.returncode in (1, 2)
        assert said in done.stderr
        assert done.stdout == ""


def test_a_video_states_nothing_but_takes_angles(tmp_path: Path) -> None:
    path = tmp_path / "descent.avi"
    film = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10, (CAMERA.width, CAMERA.height))
    for number in range(3):
        film.write(cv2.cvtColor(frame(number), cv2.COLOR_GRAY2BGR))
    film.release()
    done = asked(path, "--metadata", "--json")
    assert (done.returncode, "video" in done.stderr) == (2, True)
    done = asked(path, "--fov", "60", "--pitch", "-90", "--yaw", "0", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["up"]["source"] == "given"


@pytest.mark.usefixtures("_worker_here")
def test_every_sequence_of_a_batch_has_its_own(flight: Path, tmp_path: Path) -> None:
    (tmp_path / "flights").mkdir()
    (tmp_path / "flights" / "first").symlink_to(flight)
    command = [
        "batch",
        str(tmp_path / "flights"),
        "--command",
        "sequence",
        "--grid",
        GRID,
        "--no-overlay",
        "--metadata",
    ]
    done = slopemap(*command, "-o", str(tmp_path / "out"), "--jobs", "1")
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "out" / "first" / "slopes.json").read_text())
    assert (document["up"]["source"], document["scale"]["source"]) == ("exif", "exif")
