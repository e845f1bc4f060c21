"""`slopemap sequence`: files in, a line a frame, the same bytes again, and what it keeps when it is broken off."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from command import slopemap
from frames import CAMERA, GRID, frame, true_normals, write_frames
from jsonschema import validate
from output_names import files_of

from slopecli.io import LineFile, load_schema, read_lines
from slopecli.products import SEQUENCE_PRODUCTS
from slopecli.sequence import Sequence

SAMPLE = Path(__file__).resolve().parents[1] / "sample_data" / "descent"


@pytest.fixture(scope="module")
def descent(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("descent")
    write_frames(folder, 5)
    return folder


def arguments(descent: Path, out: Path) -> list[str]:
    camera = str(descent / "camera.json")
    return ["sequence", str(descent), "--camera", camera, "--grid", GRID, "-o", str(out)]


@pytest.fixture(scope="module")
def answered(descent: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("answered")
    done = slopemap(*arguments(descent, out))
    assert done.returncode == 0, done.stderr
    assert [line[:4] for line in done.stdout.splitlines()[:5]] == ["   1", "   2", "   3", "   4", "   5"]
    return out


def test_files_are_complete_and_fit_the_schema(answered: Path) -> None:
    assert {path.name for path in answered.iterdir()} == files_of(SEQUENCE_PRODUCTS) | {"sequence.jsonl"}
    document = json.loads((answered / "slopes.json").read_text())
    validate(document, load_schema())
    found = np.array([plane["normal_cam1"] for plane in document["planes"]])
    off = np.degrees(np.arccos(np.clip((found * true_normals()).sum(axis=1), -1, 1)))
    assert off.max() < 0.5
    assert [motion["frame"] for motion in document["motions"]] == [1, 2, 3, 4, 5]
    assert Path(document["images"][1]["path"]).name == "frame5.png"
    assert document["motion"]["baseline_cam1"] == document["motions"][-1]["motion"]["baseline_cam1"]
    length = np.linalg.norm(document["motions"][1]["motion"]["baseline_cam1"])
    assert length == pytest.approx(1.0, abs=0.02)


def test_every_frame_has_its_line(answered: Path) -> None:
    lines = read_lines(answered / "sequence.jsonl")
    assert [line["frame"] for line in lines] == [1, 2, 3, 4, 5]
    assert [line["status"] for line in lines] == ["reference", *["used"] * 4]
    document = json.loads((answered / "slopes.json").read_text())
    last = {plane["id"]: plane["slope_deg"] for plane in lines[-1]["planes"]}
    assert last == {plane["id"]: plane["slope_deg"] for plane in document["planes"]}
    with (answered / "planes.csv").open() as file:
        table = {int(row["id"]): float(row["slope_deg"]) for row in csv.DictReader(file)}
    assert table == {number: pytest.approx(slope, rel=1e-5) for number, slope in last.items()}


def test_the_trajectory_is_in_tum_format(answered: Path) -> None:
    rows = np.loadtxt(answered / "trajectory.txt")
    assert rows.shape == (5, 8)
    np.testing.assert_allclose(np.linalg.norm(rows[:, 4:], axis=1), 1.0, atol=1e-8)
    document = json.loads((answered / "slopes.json").read_text())
    x, y, z, w = rows[-1, 4:]
    R = np.array(document["motion"]["rotation_cam2_from_cam1"])
    turned = [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)]
    np.testing.assert_allclose(turned, R.T[0], atol=1e-7)


def test_the_same_frames_give_the_same_bytes(descent: Path, answered: Path, tmp_path: Path) -> None:
    assert slopemap(*arguments(descent, tmp_path)).returncode == 0
    for path in answered.iterdir():
        assert (tmp_path / path.name).read_bytes() == path.read_bytes(), path.name


def test_a_broken_frame_is_said_and_skipped(descent: Path, tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    write_frames(folder, 3)
    (folder / "frame2.png").write_bytes((descent / "frame2.png").read_bytes()[:500])
    done = slopemap(*arguments(folder, tmp_path / "out"))
    assert done.returncode == 0
    assert "frame2.png: skipped, " in done.stdout
    line = read_lines(tmp_path / "out" / "sequence.jsonl")[1]
    assert (line["status"], line["diagnostics"][0]["code"]) == ("skipped", "frame-skipped")


def test_slopes_are_told_in_the_unit_asked_for(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    write_frames(folder, 2)
    done = slopemap(*arguments(folder, tmp_path / "out"), "--slope-unit", "percent")
    assert done.returncode == 0, done.stderr
    planes = json.loads((tmp_path / "out" / "slopes.json").read_text())["planes"]
    rises = [100 * np.tan(np.radians(plane["slope_deg"])) for plane in planes]
    assert f" slopes {min(rises):.1f} to {max(rises):.1f} %, sigma " in done.stdout.splitlines()[1]
    assert [float(row.split()[1]) for row in done.stdout.splitlines()[3:]] == pytest.approx(rises, abs=0.051)


def test_a_video_gives_what_its_frames_give(descent: Path, answered: Path, tmp_path: Path) -> None:
    video = tmp_path / "descent.avi"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (CAMERA.width, CAMERA.height))
    writer.set(cv2.VIDEOWRITER_PROP_QUALITY, 100)
    for number in range(5):
        writer.write(cv2.cvtColor(frame(number), cv2.COLOR_GRAY2BGR))
    writer.release()
    out = tmp_path / "out"
    done = slopemap("sequence", str(video), *arguments(descent, out)[2:], "--start", "0", "--video")
    assert done.returncode == 0, done.stderr
    assert (out / "sequence.mp4").stat().st_size > 1000
    assert [line["time_s"] for line in read_lines(out / "sequence.jsonl")] == [0.0, 0.1, 0.2, 0.3, 0.4]
    both = [json.loads((folder / "slopes.json").read_text())["planes"] for folder in (out, answered)]
    for one, other in zip(*both, strict=True):
        assert abs(one["slope_deg"] - other["slope_deg"]) < 2 * one["slope_sigma_deg"] + 0.05


def test_it_stops_when_every_window_is_settled(descent: Path, tmp_path: Path) -> None:
    done = slopemap(*arguments(descent, tmp_path), "--stop-when", "settled", "--report")
    assert done.returncode == 0, done.stderr
    lines = read_lines(tmp_path / "sequence.jsonl")
    assert len(lines) < 5
    assert [one["verdict"] for one in lines[-1]["settled"]] == ["safe"] * 4
    page = (tmp_path / "report.html").read_text()
    assert Path(lines[-1]["image"]).name in page
    assert page.count("data:image") > 1  # both images of the last state


def test_interrupted_it_keeps_what_it_has(descent: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taken = Sequence.take

    def until_the_fourth(self: Sequence, one: object) -> object:
        if len(self.frames) == 3:
            raise KeyboardInterrupt
        return taken(self, one)  # type: ignore[arg-type]

    monkeypatch.setattr(Sequence, "take", until_the_fourth)
    done = slopemap(*arguments(descent, tmp_path))
    assert done.returncode == 130
    assert len(read_lines(tmp_path / "sequence.jsonl")) == 3
    assert len(json.loads((tmp_path / "slopes.json").read_text())["motions"]) == 3


def test_a_fault_of_the_program_is_told_after_the_answer_so_far(
    descent: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = Sequence.take

    def until_the_fourth(self: Sequence, one: object) -> object:
        return taken(self, one) if len(self.frames) < 3 else {}["no such key"]  # type: ignore[arg-type]

    monkeypatch.setattr(Sequence, "take", until_the_fourth)
    done = slopemap(*arguments(descent, tmp_path))
    assert done.returncode == 1
    assert "KeyError" in done.stderr.splitlines()[-1]
    assert "fault of slopemap" in done.stderr.splitlines()[-1]
    assert len(json.loads((tmp_path / "slopes.json").read_text())["motions"]) == 3


def test_frames_of_one_place_have_no_answer(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    write_frames(folder, 1)
    noise = np.random.default_rng(0).normal(0, 2.0, frame(0).shape)
    cv2.imwrite(str(folder / "frame2.png"), np.clip(frame(0) + noise, 0, 255).astype(np.uint8))
    done = slopemap(*arguments(folder, tmp_path / "out"))
    assert done.returncode == 3
    assert done.stderr.count("\n") == 1
    assert "too little" in done.stderr
    assert not (tmp_path / "out" / "slopes.json").exists()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "No frames"),
        (["{frames}", "--live", "0"], "--live"),
        (["{frames}/frame1.png", "-o", "{out}"], "at least two"),
        (["{frames}", "-o", "{out}", "--glob", "*.tif"], "*.tif"),
        (["{frames}", "-o", "{out}", "--times", "{frames}/camera.json"], "time in s"),
        (["{frames}/no.mp4", "-o", "{out}"], "no such video"),
        (["{frames}/nowhere", "-o", "{out}"], "no such folder"),
        (["{frames}/torn.mp4", "-o", "{out}"], "no video that OpenCV can read"),
        (["{frames}", "-o", "{out}", "--every", "2", "--fps", "3"], "--every and --fps"),
    ],
    ids=lambda value: value[-1] if isinstance(value, list) and value else None,
)
def test_what_cannot_be_used_is_refused_in_a_line(descent: Path, tmp_path: Path, given: list[str], said: str) -> None:
    places = {"frames": str(descent), "out": str(tmp_path / "out")}
    (descent / "torn.mp4").write_bytes(b"no video")
    done = slopemap("sequence", *(one.format(**places) for one in given), "--fov", "60")
    assert done.returncode in (1, 2)
    assert said in done.stderr
    assert done.returncode == 2 or done.stderr.count("\n") == 1


def test_a_reader_ignores_a_line_that_is_not_finished(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    with LineFile(path) as lines:
        lines.write(b'{"frame":1}')
    with path.open("ab") as file:
        file.write(b'{"frame":2,"ima')
    assert read_lines(path) == [{"frame": 1}]
    with LineFile(path) as lines:
        lines.write(b'{"frame":3}')
    assert read_lines(path) == [{"frame": 3}]


def test_a_map_has_the_depth_of_all_frames(descent: Path, tmp_path: Path) -> None:
    """The ground that only nearer frames show is in it, and where the last one shows it, it is as sure as that."""
    place = ["--altitude", "44", "--position", "46.5,8.0,1500", "--north", "0,-1,0"]
    done = slopemap(*arguments(descent, tmp_path), "--map", "--footprint", "48", "--spacing", "8", *place)
    assert done.returncode == 0, done.stderr
    geotiff = tifffile.TiffFile(tmp_path / "slope_map_geo.tif")
    assert geotiff.geotiff_metadata["ProjectedCSTypeGeoKey"] == 32632
    kinds = [one["properties"]["kind"] for one in json.loads((tmp_path / "slopes.geojson").read_text())["features"]]
    assert {"window", "site"} == set(kinds)
    assert "site" in done.stdout
    document = json.loads((tmp_path / "slopes.json").read_text())
    validate(document, load_schema())
    assert {"map", "sites", "motions"} <= document.keys()
    assert document["map"]["valid_share"] > 0.6
    bands = tifffile.imread(tmp_path / "slope_map.tif")
    slopes, sigmas = bands[:2] if len(bands) < 20 else np.moveaxis(bands, -1, 0)[:2]
    known = slopes > -999.0
    true_deg = np.degrees(np.arccos(-true_normals()[0, 2]))  # of all four faces
    off = np.abs(slopes[known] - true_deg)
    rows, columns = np.nonzero(known)
    middle = np.array(slopes.shape) / 2
    on_a_face = (np.abs(rows - middle[0]) > 4) & (np.abs(columns - middle[1]) > 4)
    assert np.median(off[on_a_face]) < 0.5
    assert (off[on_a_face] < 3.0 * sigmas[known][on_a_face] + 0.1).mean() > 0.95


def test_positions_give_metres(descent: Path, tmp_path: Path) -> None:
    """Turned, shifted and in steps of 2.5 m; distances alone count."""
    lines = [f"{100 + 2.5 * number:.3f} 20.0 -3.0" for number in range(5)]
    (tmp_path / "positions.txt").write_text("\n".join(lines) + "\n")
    out = tmp_path / "out"
    done = slopemap(*arguments(descent, out), "--positions", str(tmp_path / "positions.txt"))
    assert done.returncode == 0, done.stderr
    document = json.loads((out / "slopes.json").read_text())
    assert (document["scale"]["unit"], document["scale"]["source"]) == ("m", "pose")
    assert np.linalg.norm(document["motions"][-1]["motion"]["baseline_cam1"]) == pytest.approx(10.0, rel=0.01)
    assert not (out / "slopes.geojson").exists()
    (tmp_path / "positions.txt").write_text("\n".join(lines[:4]) + "\n")
    done = slopemap(*arguments(descent, out), "--positions", str(tmp_path / "positions.txt"))
    assert done.returncode == 1
    assert "4 lines for 5 frames" in done.stderr


def test_slopes_of_rough_ground_are_as_sure_as_they_say(tmp_path: Path) -> None:
    """Points sit on the edges of rocks, and neighbours err alike: less than half of the windows held before."""
    pair = [str(SAMPLE / f"image{number}.png") for number in (1, 2)]
    done = slopemap("sequence", *pair, "--camera", str(SAMPLE / "camera.json"), "-o", str(tmp_path / "out"))
    assert done.returncode == 0, done.stderr
    planes = json.loads((tmp_path / "out" / "slopes.json").read_text())["planes"]
    truth = json.loads((SAMPLE / "truth.json").read_text())["windows"]
    z = [abs(p["slope_deg"] - t["slope_deg"]) / p["slope_sigma_deg"] for p, t in zip(planes, truth, strict=True)]
    assert sum(one <= 2.0 for one in z) >= 8
    assert max(z) < 3.0
    # why the table is not the last line again
    note = next(line for line in done.stderr.splitlines() if "through all pixels" in line)
    lines = read_lines(tmp_path / "out" / "sequence.jsonl")
    before = {plane["id"]: plane["slope_deg"] for plane in lines[-1]["planes"]}
    others = [str(plane["id"]) for plane in planes if plane["slope_deg"] != before[plane["id"]]]
    assert others
    assert f"windows {', '.join(others)}," in note
