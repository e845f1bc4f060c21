"""`slopemap solve`: a user's own correspondences, from a CSV file to slopes."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import threading
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator

from slopecli.cli import run, slopemap
from slopecli.geometry import homogeneous
from slopecli.io import load_schema, read_correspondences
from slopecli.study import Scene, make_scene, project

Ask = Callable[..., tuple[int, str, str]]


@pytest.fixture
def ask(capsys: pytest.CaptureFixture[str]) -> Ask:
    """Exit status, stdout and stderr of `slopemap solve` with these arguments."""

    def asked(*arguments: str) -> tuple[int, str, str]:
        status = run(slopemap, ["solve", *map(str, arguments)])
        return status, *capsys.readouterr()

    return asked


def scene_of(seed: int = 1, noise_px: float = 0.0, **changes: Any) -> Scene:
    return make_scene(np.random.default_rng(seed), noise_px=noise_px, **changes)


def write_rows(path: Path, scene: Scene, rays: bool = False, **columns: Any) -> Path:
    """A scene as CSV; patches are called 1, 2, ... `columns` replace or add some."""
    x1, x2 = (scene.x1, scene.x2) if rays else (scene.uv1, scene.uv2)
    table = {
        "x1": x1[:, 0], "y1": x1[:, 1], "x2": x2[:, 0], "y2": x2[:, 1],
        "patch": np.where(scene.patch < 0, -1, scene.patch + 1), **columns,
    }  # fmt: skip
    table = {name: list(values) for name, values in table.items() if values is not None}
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(table)
        writer.writerows(zip(*table.values(), strict=True))
    return path


def camera_file(path: Path, scene: Scene) -> str:
    camera = scene.camera
    values = {name: getattr(camera, name) for name in ("width", "height", "fx", "fy", "cx", "cy")}
    path.write_text(json.dumps({**values, "distortion": list(camera.distortion)}), encoding="utf-8")
    return str(path)


# ---- exactness ----


def test_slopes_of_a_simulated_scene_are_exact(tmp_path: Path, ask: Ask) -> None:
    scene = scene_of()
    matches = write_rows(tmp_path / "m.csv", scene)
    status, out, _ = ask(matches, "--camera", camera_file(tmp_path / "c.json", scene), "--json")
    assert status == 0
    result = json.loads(out)
    assert not list(Draft202012Validator(load_schema()).iter_errors(result))
    assert [plane["id"] for plane in result["planes"]] == list(range(1, 10))
    assert {plane["source"] for plane in result["planes"]} == {"given"}
    assert [plane["slope_deg"] for plane in result["planes"]] == pytest.approx(np.degrees(scene.slopes), abs=1e-5)
    assert np.array(result["motion"]["rotation_cam2_from_cam1"]) == pytest.approx(scene.R, abs=1e-7)
    assert result["motion"]["baseline_cam1"] == pytest.approx(scene.T / np.linalg.norm(scene.T), abs=1e-7)
    assert result["images"][0]["path"] == str(matches)
    assert (result["images"][0]["width"], len(result["images"][0]["sha256"])) == (scene.camera.width, 64)
    assert "grid" not in result["options"]


SINGULAR = """\
0.1577448695898056,-3.0,-1.3896218538284302,3.0,1
1000000000.0,0.31749287247657776,0.0,0.0,1
179.25747680664062,1.5292483568191528,-1.0,0.32037726044654846,2
1e-12,1000000000.0,0.0,-0.0,1
511.5,933.3795166015625,0.0,-1.0,1
129.9193878173828,0.0,-1.9536142349243164,129.9193878173828,-1
0.0,0.0,549.5769653320312,58.47373580932617,1
-3.0,1.577950119972229,-1.0,0.0,1
-1.5857146978378296,14.272550582885742,964.450439453125,9.999999747378752e-06,2
1.0,0.0,-0.0,1.401298464324817e-45,1
0.539842963218689,511.5,1.0,-3.0,1
1000000000.0,3.0,0.0,0.0,-1
254.15664672851562,1.0,-3.0,0.0,3
959.890625,1e-12,-2.0,1.577950119972229,-1
0.5,0.0,-3.0,-3.0,2
0.5,1.0,1000000000.0,-1.0,-1
"""


def test_rows_that_make_a_system_exactly_singular_are_said_to_determine_nothing(tmp_path: Path, ask: Ask) -> None:
    (tmp_path / "m.csv").write_text(f"x1,y1,x2,y2,patch\n{SINGULAR}", "utf-8")
    status, _, err = ask(tmp_path / "m.csv", "--noise", "0.3", "--json")
    assert status == 3
    assert "do not determine" in err


def test_equations_beyond_the_numbers_of_a_computer_are_refused(tmp_path: Path, ask: Ask) -> None:
    rows = ["0,0,0,0,1", "0,0,0,0,1", "0,0,0,1,1", "0,1,0,1000000000,1", "1,0,0,0,1"]
    (tmp_path / "m.csv").write_text("\n".join(["x1,y1,x2,y2,patch", *rows]) + "\n", "utf-8")
    status, _, err = ask(tmp_path / "m.csv", "--json")
    assert status == 3
    assert "too far apart" in err


def test_rays_need_no_camera_and_have_residuals_in_milliradians(tmp_path: Path, ask: Ask) -> None:
    scene = scene_of(noise_px=0.3)
    status, out, _ = ask(write_rows(tmp_path / "m.csv", scene, rays=True), "--json")
    assert status == 0
    result = json.loads(out)
    assert not list(Draft202012Validator(load_schema()).iter_errors(result))
    off = [p["slope_deg"] - s for p, s in zip(result["planes"], np.degrees(scene.slopes), strict=True)]
    sigmas = [plane["slope_sigma_deg"] for plane in result["planes"]]
    assert (np.abs(off) < 4 * np.array(sigmas)).all()
    assert result["fit"]["noise_px"] is result["fit"]["rms_px"] is result["planes"][0]["rms_px"] is None
    assert result["fit"]["noise_mrad"] == pytest.approx(1e3 * scene.noise, rel=0.15)
    assert result["planes"][0]["rms_mrad"] == pytest.approx(1e3 * scene.noise, rel=0.3)
    assert result["images"][0]["width"] is None
    assert result["cameras"][0]["source"] == "rays"


def test_pixels_and_rays_are_one_scene(tmp_path: Path, ask: Ask) -> None:
    scene = scene_of(noise_px=0.2)
    camera = scene.camera
    intrinsics = f"{camera.fx},{camera.fy},{camera.cx},{camera.cy}"
    px = ask(write_rows(tmp_path / "px.csv", scene), "--intrinsics", intrinsics, "--json", "--noise", "0.2")[1]
    mrad = repr(1e3 * 0.2 / camera.focal_px)
    rays = ask(write_rows(tmp_path / "rays.csv", scene, rays=True), "--json", "--noise", mrad)[1]
    for one, two in zip(json.loads(px)["planes"], json.loads(rays)["planes"], strict=True):
        for key in ("slope_deg", "slope_sigma_deg", "p_safe"):
            assert one[key] == pytest.approx(two[key], rel=1e-5, abs=1e-7)


def test_table_talk_and_files(tmp_path: Path, ask: Ask) -> None:
    scene = scene_of(noise_px=0.3)
    status, out, err = ask(write_rows(tmp_path / "m.csv", scene, rays=True), "-o", str(tmp_path / "out"))
    assert status == 0
    lines = out.splitlines()
    assert lines[0].split()[:2] == ["id", "slope"]
    assert [int(line.split()[0]) for line in lines[1:]] == list(range(1, 10))
    assert "camera 1 taken to look straight down" in err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["slopes.json"]


# ---- what else is known ----


def test_sigmas_of_rows_weigh_them(tmp_path: Path, ask: Ask) -> None:
    """Half of the rows ten times worse, and said to be: as good as without them, not as bad as with."""
    rng = np.random.default_rng(5)
    scene = scene_of(noise_px=0.2)
    sigma = np.where(rng.random(len(scene.x1)) < 0.5, 2.0, 0.2)
    x2 = scene.uv2 + np.where(sigma > 1, 2.0, 0.0)[:, None] * rng.standard_normal(scene.uv2.shape)
    moved = {"x2": x2[:, 0], "y2": x2[:, 1]}
    camera = ("--camera", camera_file(tmp_path / "c.json", scene), "--json")
    weighed = json.loads(ask(write_rows(tmp_path / "w.csv", scene, sigma=sigma, **moved), *camera)[1])
    alike = json.loads(ask(write_rows(tmp_path / "a.csv", scene, **moved), *camera)[1])
    errors = [
        np.abs([p["slope_deg"] - s for p, s in zip(result["planes"], np.degrees(scene.slopes), strict=True)])
        for result in (weighed, alike)
    ]
    sigmas = [np.array([plane["slope_sigma_deg"] for plane in result["planes"]]) for result in (weighed, alike)]
    assert np.median(sigmas[0]) < 0.5 * np.median(sigmas[1])
    assert (errors[0] < 4 * sigmas[0]).all()


def test_a_prior_decides_and_the_warning_says_which(tmp_path: Path, ask: Ask) -> None:
    flat = scene_of(2, 0.3, slopes_deg=[0.0] * 9, height_spread=0.0)
    matches = write_rows(tmp_path / "m.csv", flat)
    camera = ("--camera", camera_file(tmp_path / "c.json", flat))
    status, out, err = ask(matches, *camera)
    assert status == 0
    assert all(re.search(r"± [\d.]+° or [\d.]+ ± ", line) for line in out.splitlines()[1:])
    assert "two answers" in err
    assert "--direction-prior with a sigma below" in err
    direction = ",".join(f"{value:.6f}" for value in flat.T)
    status, out, err = ask(matches, *camera, "--direction-prior", f"{direction},1")
    assert " or " not in out
    assert "two answers" not in err
    opposite = ask(matches, *camera, "--direction-prior", "0,1,0,0.5")[2]
    assert "prior-contradicted" in opposite


def test_scale_merging_and_the_largest_sigma_reach_the_answer(tmp_path: Path, ask: Ask) -> None:
    scene = scene_of(3, 0.3)
    matches = write_rows(tmp_path / "m.csv", scene, rays=True)
    result = json.loads(ask(matches, "--json", "--baseline", "12.5", "--merge-coplanar", "--max-sigma", "0.01")[1])
    assert (result["scale"]["unit"], result["options"]["merge_coplanar"]) == ("m", True)
    assert np.linalg.norm(result["motion"]["baseline_cam1"]) == pytest.approx(12.5)
    assert " m " not in ask(matches, "--baseline", "12.5")[1]
    assert all("--max-sigma 0.01" in plane["reason"] for plane in result["planes"])


def test_an_up_that_is_hardly_known_is_named_as_the_cause(tmp_path: Path, ask: Ask) -> None:
    status, out, err = ask(write_rows(tmp_path / "m.csv", scene_of(noise_px=0.3), rays=True), "--up-sigma", "89.9")
    assert (status, out) == (3, "")
    assert "up-unknown" in err
    assert "--up-sigma" in err
    assert "texture" not in err


def test_directions_may_have_any_length(tmp_path: Path, ask: Ask) -> None:
    matches = write_rows(tmp_path / "m.csv", scene_of(3, 0.3), rays=True)
    plain, huge, tiny = (
        ask(matches, f"--up={length},0,-{length}", "--north", f"0,{length},0") for length in ("1", "1e200", "1e-200")
    )
    assert plain[0] == 0
    assert plain == huge == tiny


def test_a_camera_that_only_turned_gives_no_answer(tmp_path: Path, ask: Ask) -> None:
    scene = scene_of()
    turned = np.column_stack([scene.x1, np.ones(len(scene.x1))]) @ scene.R.T
    matches = write_rows(
        tmp_path / "m.csv", scene, rays=True, x2=turned[:, 0] / turned[:, 2], y2=turned[:, 1] / turned[:, 2]
    )
    status, out, err = ask(matches)
    assert (status, out) == (3, "")
    assert "pure-rotation" in err


# ---- the file ----


def test_columns_in_any_order_quoted_with_an_index_and_floats_for_patches(tmp_path: Path, ask: Ask) -> None:
    """As other programs write it: an index without a name, a patch that is 3.0 or empty, a byte order mark."""
    scene = scene_of()
    plain = read_correspondences(write_rows(tmp_path / "m.csv", scene, rays=True))
    rows = ['"","patch","y2","x2","score","y1","x1"']
    for i, (a, b, patch) in enumerate(zip(scene.x1.tolist(), scene.x2.tolist(), scene.patch.tolist(), strict=True)):
        name = "" if patch < 0 else f"{patch + 1}.0"
        rows.append(f'{i},{name},"{b[1]!r}",{b[0]!r},good,{a[1]!r},"{a[0]!r}"')
    other = tmp_path / "other.csv"
    other.write_text("\r\n".join(rows) + "\r\n\r\n", encoding="utf-8-sig", newline="")
    read = read_correspondences(other)
    assert np.array_equal(read.xy1, plain.xy1)
    assert np.array_equal(read.xy2, plain.xy2)
    assert np.array_equal(read.patch, plain.patch)


def test_without_patches_all_rows_lie_on_one_plane(tmp_path: Path, ask: Ask) -> None:
    scene = scene_of(slopes_deg=[0.0] * 9, height_spread=0.0)
    chosen = scene.patch >= 0
    x1, x2 = scene.x1[chosen], scene.x2[chosen]
    path = tmp_path / "m.csv"
    rows = "\n".join(",".join(map(repr, (*a, *b))) for a, b in zip(x1.tolist(), x2.tolist(), strict=True))
    path.write_text(f"x1,y1,x2,y2\n{rows}\n", encoding="utf-8")
    status, out, _ = ask(path, "--json")
    assert status == 0
    result = json.loads(out)
    either = [result["planes"], result["ambiguity"]["alternative"]["planes"]]
    assert [[plane["id"] for plane in planes] for planes in either] == [[1], [1]]
    assert min(planes[0]["slope_deg"] for planes in either) < 1e-4


def test_a_patch_that_makes_no_plane_is_named_among_those_refused(tmp_path: Path, ask: Ask) -> None:
    scene = scene_of()
    patch = np.where(scene.patch < 0, -1, scene.patch)  # the first is called 0
    few, line = np.flatnonzero(patch == 2)[:2], patch == 5
    patch[patch == 2] = -1
    patch[few] = 70
    x1, x2 = scene.x1.copy(), scene.x2.copy()
    x1[line, 1] = x1[line, 0]
    x2[line] = project(scene.R, scene.T, x1[line], homogeneous(x1[line]) @ scene.normals[5])
    patch[line] = 80
    moved = {"y1": x1[:, 1], "x2": x2[:, 0], "y2": x2[:, 1]}
    status, out, err = ask(write_rows(tmp_path / "m.csv", scene, rays=True, patch=patch, **moved), "--json")
    assert status == 0
    result = json.loads(out)
    assert [plane["id"] for plane in result["planes"]] == [0, 1, 3, 4, 6, 7, 8]
    assert [(one["id"], one["reason"]) for one in result["rejected"]] == [
        (70, "too-few-points"),
        (80, "too-few-points"),
    ]
    assert not list(Draft202012Validator(load_schema()).iter_errors(result))
    assert "plane 70: no answer: too-few-points: it has 2 rows, and a plane needs 3" in err
    assert "plane 80: no answer" in err


GOOD = "x1,y1,x2,y2,patch\n" + "\n".join(f"0.{i},0.{i * i},0.1{i},0.2{i},1" for i in range(9))


@pytest.mark.parametrize("largest", [70_008, 2**31 - 1])
def test_numbers_of_patches_may_be_large(largest: int, tmp_path: Path, ask: Ask) -> None:
    scene = scene_of(noise_px=0.3)
    patch = np.where(scene.patch < 0, -1, scene.patch + largest - 8)
    status, out, _ = ask(write_rows(tmp_path / "m.csv", scene, rays=True, patch=patch), "--json")
    assert status == 0
    assert [plane["id"] for plane in json.loads(out)["planes"]] == list(range(largest - 8, largest + 1))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "has no column x1, y1, x2, y2 (its first line is: nothing)"),
        ("x1,y1,x2\n1,2,3\n", "has no column y2 (its first line is: x1, y1, x2)"),
        ("1,2,3\n1,2,3\n", "has 3 columns and no header (its first line is: 1, 2, 3)"),
        ("0 1 2 3 4 5\n1 1 2 3 4 5\n", "has 6 columns and no header (its first line is: 0, 1, 2, 3, 4, 5)"),
        ("0.1 0.2 0.3 0.4 0.93\n", "row 1 (line 1): patch is '0.93', needed the number of a plane"),
        ("0.1 0.2 0.3 0.4\n0.1 0.2 0.3\n", "row 2 (line 2) has 3 cells"),
        ("x1,y1,x2,y2,x1\n", "has two columns x1"),
        ("x1,y1,x2,y2\n", "has no rows under its header"),
        (GOOD + "\n0.1,oops,0.3,0.4,1\n", "row 10 (line 11): y1 is 'oops', needed a finite number"),
        (GOOD + "\n\n0.1,,0.3,0.4,1\n", "row 10 (line 12): y1 is '', needed a finite number"),
        (GOOD + "\n0.1,nan,0.3,0.4,1\n", "row 10 (line 11): y1 is 'nan', needed a finite number"),
        (GOOD + "\n0.1,0.2,1e999,0.4,1\n", "x2 is '1e999', needed a finite number"),
        (GOOD + "\n0.1,0.2,0.3,-1e38,1\n", "y2 is '-1e38', needed one up to 1e+09"),
        (GOOD + "\n0.1,0.2,0.3\n", "row 10 (line 11) has 3 cells"),
        (GOOD + "\n0.1,0.2,0.3,0.4,1.5\n", "patch is '1.5', needed the number of a plane"),
        (GOOD + "\n0.1,0.2,0.3,0.4,-2\n", "patch is '-2', needed the number of a plane"),
        ("x1,y1,x2,y2,sigma\n0.1,0.2,0.3,0.4,0\n", "row 1 (line 2): sigma is '0'"),
        (GOOD.replace(",1\n", ",-1\n").replace("0.28,1", "0.28,-1"), "no patch has 3 rows off a line"),
        ('x1,y1,x2,y2\n"0.1,0.2,0.3,0.4\n', "is not CSV text"),
        ("x1,y1,x2,y2\n0,0,0,0\n0,0,0,0\n0,-0.0,0,0\n", "no patch has 3 rows off a line"),
    ],
)
def test_bad_files_are_refused_in_one_line(text: str, said: str, tmp_path: Path, ask: Ask) -> None:
    path = tmp_path / "m.csv"
    path.write_text(text, encoding="utf-8")
    status, out, err = ask(path)
    assert (status, out, len(err.splitlines())) == (1, "", 1)
    assert err.startswith(f"slopemap: error: {path}: ")
    assert said in err


def test_too_few_rows_are_refused_with_how_many_are_needed(tmp_path: Path, ask: Ask) -> None:
    path = tmp_path / "m.csv"
    path.write_text("x1,y1,x2,y2\n0,0,0.1,0\n1,0,1.1,0.01\n0,1,0.1,1\n", encoding="utf-8")
    status, _, err = ask(path)
    assert status == 3
    assert "need 9 measurements, found 6" in err


def test_rows_from_stdin_and_from_pipes(tmp_path: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_rows(tmp_path / "m.csv", scene_of(noise_px=0.3), rays=True)
    expected = json.loads(ask(path, "--json")[1])
    monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(path.read_bytes())))
    piped = json.loads(ask("-", "--json")[1])
    assert piped["planes"] == expected["planes"]
    assert piped["images"][0] == {**expected["images"][0], "path": "-"}
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(path.read_bytes(),))
    writer.start()
    assert json.loads(ask(pipe, "--json")[1])["planes"] == expected["planes"]
    writer.join()


def test_a_field_of_view_is_a_camera(tmp_path: Path, ask: Ask) -> None:
    scene = scene_of(noise_px=0.3)
    matches = write_rows(tmp_path / "m.csv", scene)
    camera = json.loads(ask(matches, "--camera", camera_file(tmp_path / "c.json", scene), "--json")[1])
    guessed = ("--fov", "60", "--size", "1024x1024", "--json")
    fov = json.loads(ask(matches, *guessed, "--focal-sigma", "0")[1])
    assert [p["slope_deg"] for p in fov["planes"]] == pytest.approx([p["slope_deg"] for p in camera["planes"]])
    unsure = json.loads(ask(matches, *guessed)[1])[
        "planes"
    ]  # the rows tell the focal length better than the 3 % it is given
    assert all(
        abs(p["slope_deg"] - q["slope_deg"]) < 2 * p["slope_sigma_deg"]
        for p, q in zip(unsure, camera["planes"], strict=True)
    )
    assert all(p["slope_sigma_deg"] > q["slope_sigma_deg"] for p, q in zip(unsure, camera["planes"], strict=True))
    assert fov["images"][0]["width"] == 1024
    for alone in (("--fov", "60"), ("--size", "1024x1024"), ("--fov", "60", "--size", "9x9", "--camera", "x.json")):
        assert ask(matches, *alone)[0] == 2


def test_tables_of_spreadsheets_are_read_in_their_encodings(tmp_path: Path, ask: Ask) -> None:
    plain = write_rows(tmp_path / "m.csv", make_scene(np.random.default_rng(1), points=20), rays=True)
    status, wanted, _ = ask(plain)
    assert status == 0
    for encoding, comment in (("utf-16", "# Köln"), ("utf-8-sig", ""), ("latin-1", "# Köln")):
        (tmp_path / "other.csv").write_bytes(f"{comment}\n{plain.read_text()}".encode(encoding))
        assert ask(tmp_path / "other.csv")[1] == wanted
    (tmp_path / "other.csv").write_bytes(plain.read_text().encode("utf-16-le"))
    assert "is UTF-16 without its mark" in ask(tmp_path / "other.csv")[2]


def test_other_bad_inputs(tmp_path: Path, ask: Ask) -> None:
    scene = scene_of()
    assert "no such file of correspondences" in ask(tmp_path / "none.csv")[2]
    assert "is a folder" in ask(tmp_path)[2]
    assert "is not a regular file" in ask("/dev/null")[2]
    (tmp_path / "bytes.csv").write_bytes(b"\x89PNG\xff\xfe")
    assert "is not CSV text" in ask(tmp_path / "bytes.csv")[2]
    matches = write_rows(tmp_path / "m.csv", scene, sigma=np.ones(len(scene.x1)))
    assert ask(matches, "--noise", "0.3")[0] == 2
    assert ask(matches, "--camera2", "x.json")[0] == 2
    assert ask(matches, "--camera", "x.json", "--intrinsics", "1,1,0,0")[0] == 2


def test_pixels_without_a_camera_are_not_taken_for_rays(tmp_path: Path, ask: Ask) -> None:
    status, out, err = ask(write_rows(tmp_path / "m.csv", scene_of()), "-o", tmp_path / "out")
    assert (status, out) == (1, "")
    assert "are pixels and no rays" in err
    assert "--camera" in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("mark", [";", "\t", " ", "   "])
def test_columns_may_be_separated_otherwise(tmp_path: Path, ask: Ask, mark: str) -> None:
    path = write_rows(tmp_path / "m.csv", scene_of(), rays=True)
    wanted = ask(str(path), "--json")[1]
    path.write_text(path.read_text(encoding="utf-8").replace(",", mark), encoding="utf-8")
    assert json.loads(ask(str(path), "--json")[1])["planes"] == json.loads(wanted)["planes"]


def test_rows_without_a_match_written_as_zeros_are_named(tmp_path: Path, ask: Ask) -> None:
    scene = scene_of()
    columns = {name: np.where(np.arange(len(scene.uv1)) % 2, 0.0, scene.uv1[:, 0]) for name in ("x1", "y1", "x2", "y2")}
    status, _, err = ask(str(write_rows(tmp_path / "m.csv", scene, **columns)), "--intrinsics", "500,500,0,0")
    assert status == 1
    assert "rows have the point (0, 0) in image 1" in err
    assert "leave out rows without a match" in err


def test_rows_whose_points_are_on_one_line_in_image_2_end_in_one_line(tmp_path: Path, ask: Ask) -> None:
    scene = scene_of()
    path = write_rows(tmp_path / "m.csv", scene, y2=np.zeros(len(scene.uv1)))
    status, out, err = ask(str(path), "--intrinsics", "800,800,511.5,511.5", "--noise", "0.3", "--json")
    assert (status, out, len(err.splitlines())) == (3, "", 1)
    assert "unexpected" not in err


def test_points_far_outside_any_image_take_no_memory(tmp_path: Path, ask: Ask) -> None:
    """Blocks of pixels are numbered over the whole range of the coordinates."""
    scene = scene_of()
    far = {name: 1000.0 * values for name, values in zip(("x1", "y1"), scene.uv1.T, strict=True)}
    far |= {name: 1000.0 * values for name, values in zip(("x2", "y2"), scene.uv2.T, strict=True)}
    path = write_rows(tmp_path / "m.csv", scene, **far)
    tracemalloc.start()
    status, _, _ = ask(str(path), "--intrinsics", "8e5,8e5,5e5,5e5", "--json")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert status == 0
    assert peak < 100e6
