"""Correspondences of other tools: each format in its tool's own conventions gives the same points; twins do not."""

from __future__ import annotations

import builtins
import json
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from match_factory import MAX_IDS, archive, colmap_database, hloc_files, two_column_files

from slopecli.cli import run, slopemap
from slopecli.errors import InputError
from slopecli.io import MATCH_FORMATS, read_correspondences
from slopecli.study import Scene, make_scene

Ask = Callable[..., tuple[int, str, str]]
FLOAT32_PX = 1e-4  # rounding of a coordinate below 1024 px that is written with 32 bits
SCENE = make_scene(np.random.default_rng(1), noise_px=0.2)
A, B, C = "left/a.jpg", "b_1.jpg", "c.jpg"


@pytest.fixture
def ask(capsys: pytest.CaptureFixture[str]) -> Ask:
    """Exit status, stdout and stderr of `slopemap solve` with these arguments."""

    def asked(*arguments: object) -> tuple[int, str, str]:
        return run(slopemap, ["solve", *map(str, arguments)]), *capsys.readouterr()

    return asked


def points_and_pairs(scene: Scene = SCENE) -> tuple[dict[str, np.ndarray], dict[tuple[str, str], np.ndarray]]:
    """Three images with their points, each in an order of its own, and matches of two pairs."""
    rng, n = np.random.default_rng(7), len(scene.uv1)
    order1, order2 = rng.permutation(n), rng.permutation(n)
    extra = rng.uniform(0, 1000, (9, 2))  # matched with nothing
    points = {A: np.vstack([scene.uv1[order1], extra]), B: np.vstack([extra, scene.uv2[order2]]), C: extra}
    index1, index2 = np.argsort(order1), np.argsort(order2) + len(extra)
    return points, {(A, B): np.column_stack([index1, index2]), (B, C): np.array([[0, 0], [1, 1], [2, 2]])}


def sorted_rows(given: Any) -> np.ndarray:
    table = np.hstack([given.xy1, given.xy2])
    return table[np.lexsort(table.T)]


def expected(turned: bool = False) -> np.ndarray:
    table = np.hstack([SCENE.uv2, SCENE.uv1] if turned else [SCENE.uv1, SCENE.uv2])
    return table[np.lexsort(table.T)]


def written_in(form: str, folder: Path) -> tuple[Path, dict[str, Any]]:
    """A file of that format and what else `read_correspondences` needs."""
    points, pairs = points_and_pairs()
    if form == "COLMAP 3":
        return colmap_database(folder / "d.db", points, pairs), {"pair": (A, B)}
    if form == "COLMAP 4":
        return colmap_database(folder / "d.db", points, pairs, version=4, columns=2), {"pair": (A, B)}
    if form in ("hloc", "hloc 1.0"):
        matches, features = hloc_files(folder, points, pairs, old=form == "hloc 1.0")
        return matches, {"pair": (A, B), "keypoints": features}
    if form == "two columns":
        points = {name.replace("/", "-"): xy for name, xy in points.items()}
        pairs = {(first.replace("/", "-"), second): rows for (first, second), rows in pairs.items()}
        matches, features = two_column_files(folder, points, pairs)
        return matches, {"pair": (A.replace("/", "-"), B), "keypoints": features}
    xy1, xy2, rows = points[A], points[B], pairs[A, B]
    partner = np.full(len(xy1), -1)
    partner[rows[:, 0]] = rows[:, 1]
    table = np.hstack([SCENE.uv1, SCENE.uv2])
    contents = {
        "SuperGlue": lambda: archive(keypoints0=xy1, keypoints1=xy2, matches=partner, match_confidence=partner / 2),
        "LightGlue": lambda: archive(kpts0=xy1[None], kpts1=xy2[None], matches=rows),
        "OpenCV": lambda: archive(src_pts=SCENE.uv1[:, None], dst_pts=SCENE.uv2[:, None], H=np.eye(3)),
        "columns": lambda: archive(**dict(zip(("x1", "y1", "x2", "y2"), table.T, strict=True))),
        "one array": lambda: archive(arr_0=table),
    }
    path = folder / "m.npz"
    if form in contents:
        path.write_bytes(contents[form]())
    elif form == "npy":
        path = folder / "m.npy"
        np.save(path, table)
    elif form == "savetxt":
        np.savetxt(path, table, fmt="%.9g", header="made by hand, at noon\nx1 y1 x2 y2")
    elif form == "headerless":
        np.savetxt(path, table, fmt="%.9g", delimiter=",")
    elif form == "aligned":
        path.write_text("\n".join("\t ".join(f"{value:>16.9g}" for value in row) for row in table) + "\n")
    return path, {}


FORMS = (
    *("COLMAP 3", "COLMAP 4", "hloc", "hloc 1.0", "two columns", "SuperGlue", "LightGlue", "OpenCV", "columns"),
    *("one array", "npy", "savetxt", "headerless", "aligned"),
)


@pytest.mark.parametrize("form", FORMS)
def test_every_tool_s_file_gives_the_same_points(form: str, tmp_path: Path) -> None:
    path, arguments = written_in(form, tmp_path)
    given = read_correspondences(path, **arguments)
    assert sorted_rows(given) == pytest.approx(expected(), abs=FLOAT32_PX)
    assert not given.has_patch
    assert set(given.patch) == {1}
    if arguments:
        assert given.pixels
        assert given.names == arguments["pair"]


@pytest.mark.parametrize("form", ["COLMAP 3", "COLMAP 4", "hloc", "hloc 1.0"])
def test_a_pair_may_be_asked_for_either_way_round(form: str, tmp_path: Path) -> None:
    path, arguments = written_in(form, tmp_path)
    given = read_correspondences(path, **{**arguments, "pair": (B, A)})
    assert sorted_rows(given) == pytest.approx(expected(turned=True), abs=FLOAT32_PX)
    assert given.names == (B, A)


def test_every_format_is_read_here() -> None:
    assert [form.name for form in MATCH_FORMATS] == ["COLMAP database", "HDF5", "NumPy archive", "NumPy array", "table"]


def test_a_database_solves_with_its_own_camera_and_half_a_pixel_matters(tmp_path: Path, ask: Ask) -> None:
    """Keypoints and principal point are both moved by half a pixel: the slopes are those of the scene itself."""
    camera = SCENE.camera
    inside = (1, camera.width, camera.height, (camera.fx, camera.fy, camera.cx + 0.5, camera.cy + 0.5))
    points, pairs = points_and_pairs()
    database = colmap_database(tmp_path / "d.db", points, pairs, camera=inside)
    labels = np.zeros((camera.height, camera.width), np.uint16)
    for number in range(9):
        for u, v in np.rint(SCENE.uv1[SCENE.patch == number]).astype(int):
            labels[v, u] = number + 1
    cv2.imwrite(str(tmp_path / "labels.png"), labels)
    own = ("--pair", A, B, "--labels", tmp_path / "labels.png", "--json", "--noise", "0.2")
    status, out, err = ask(database, *own)
    assert status == 0, err
    result = json.loads(out)
    table = np.column_stack([SCENE.uv1, SCENE.uv2, np.where(SCENE.patch < 0, -1, SCENE.patch + 1)])
    np.savetxt(tmp_path / "m.txt", table, fmt="%.9g")
    intrinsics = f"{camera.fx},{camera.fy},{camera.cx},{camera.cy}"
    plain = json.loads(ask(tmp_path / "m.txt", "--intrinsics", intrinsics, "--json", "--noise", "0.2")[1])
    slopes = [[plane["slope_deg"] for plane in answer["planes"]] for answer in (result, plain)]
    assert slopes[0] == pytest.approx(slopes[1], abs=2e-3)
    assert [image["path"] for image in result["images"]] == [f"{database}#{A}", f"{database}#{B}"]
    assert (result["cameras"][0]["cx"], result["images"][0]["width"]) == (pytest.approx(camera.cx), camera.width)
    assert (result["options"]["planes"], result["options"]["labels"]) == ("labels", str(tmp_path / "labels.png"))


def test_the_pairs_of_a_file_are_listed(tmp_path: Path, ask: Ask) -> None:
    for form in ("COLMAP 3", "hloc"):
        path, arguments = written_in(form, tmp_path)
        files = ("--keypoints", arguments["keypoints"]) if "keypoints" in arguments else ()
        status, out, err = ask(path, *files)
        assert (status, out, len(err.splitlines())) == (1, "", 1)
        assert "holds 2 pairs of images with matches" in err
        assert f"{A} {B} (" in err
        assert "choose one with --pair NAME1 NAME2" in err
        status, _, err = ask(path, *files, "--pair", A, "none.jpg")
        assert status == 1
        assert f"has no matches of '{A}' and 'none.jpg': {A} {B} (" in err


@pytest.mark.filterwarnings("error")
def test_signalling_nan_in_a_database_is_refused_in_one_line(tmp_path: Path, ask: Ask) -> None:
    points, pairs = points_and_pairs()
    broken = damaged(colmap_database(tmp_path / "d.db", points, pairs))
    with closing(sqlite3.connect(broken)) as database:
        (data,) = database.execute("SELECT data FROM keypoints WHERE image_id = 1").fetchone()
        signalling = bytes.fromhex("0100a07f") * 2
        database.execute("UPDATE keypoints SET data = ? WHERE image_id = 1", (signalling * (len(data) // 8),))
        database.commit()
    status, _, err = ask(broken, "--pair", A, B, "--json")
    assert status == 1
    assert "needed finite numbers" in err
    assert err.count("\n") <= 2


def test_points_of_a_database_are_never_taken_for_rays(tmp_path: Path, ask: Ask) -> None:
    points = {A: SCENE.uv1 / 1e3, B: SCENE.uv2 / 1e3}
    rows = np.column_stack([np.arange(len(SCENE.uv1))] * 2)
    database = colmap_database(tmp_path / "d.db", points, {(A, B): rows}, known=False)
    status, _, err = ask(database)
    assert status == 1
    assert "its points are pixels; give the camera" in err
    assert "info: the focal length of its cameras is COLMAP's guess and was not used" in err


# ---- twins ----


def damaged(path: Path, *statements: str) -> Path:
    database = sqlite3.connect(path)
    for statement in statements:
        database.execute(statement)
    database.commit()
    database.close()
    return path


DATABASES: dict[str, tuple[tuple[str, ...], dict[str, Any], str]] = {
    "other pair ids": (
        (f"UPDATE two_view_geometries SET pair_id = pair_id / {MAX_IDS} * {MAX_IDS + 1} + pair_id % {MAX_IDS}",),
        {},
        "does not name two of its images",
    ),
    "only raw matches": ((), {"verified": False}, "of its 2 matched pairs none is verified"),
    "nothing matched": (("DELETE FROM matches", "DELETE FROM two_view_geometries"), {}, "has no matches"),
    "a watermark": ((), {"config": 7}, "of a watermark"),
    "keypoints of another run": (
        ("UPDATE keypoints SET rows = 3, data = substr(data, 1, 72) WHERE image_id = 1",),
        {},
        "of another run than the matches",
    ),
    "three columns": (("UPDATE keypoints SET cols = 3",), {}, "has 3 columns, needed 2 or 4 or 6"),
    "64 bits": (("UPDATE keypoints SET data = CAST(data || data AS BLOB)",), {}, "bytes long and should be"),
    "a text": (("UPDATE two_view_geometries SET data = 'abc'",), {}, "has a damaged array of numbers"),
    "another program's": (("DROP TABLE keypoints",), {}, "has no table keypoints; needed a database.db of COLMAP"),
    "a view": (
        ("ALTER TABLE keypoints RENAME TO k", "CREATE VIEW keypoints AS SELECT * FROM k"),
        {},
        "has no table keypoints",
    ),
    "an old one": (("ALTER TABLE two_view_geometries RENAME TO inlier_matches",), {}, "of a COLMAP before 3.5"),
    "a camera without parameters": (("UPDATE cameras SET params = x'00'",), {}, "its camera 1"),
    "a camera that is not supported": ((), {"camera": (7, 1024, 1024, (1.0,) * 5)}, "FOV is not supported"),
}


@pytest.mark.parametrize("name", DATABASES)
def test_databases_that_are_not_what_they_seem(name: str, tmp_path: Path) -> None:
    statements, changes, said = DATABASES[name]
    path = damaged(colmap_database(tmp_path / "d.db", *points_and_pairs(), **changes), *statements)
    with pytest.raises(InputError) as refused:
        read_correspondences(path, (A, B))
    assert said in str(refused.value)
    assert str(refused.value).startswith(f"{path}: ")


def test_a_database_in_use_and_a_damaged_one(tmp_path: Path) -> None:
    path = colmap_database(tmp_path / "d.db", *points_and_pairs())
    content = path.read_bytes()
    (tmp_path / "d.db-wal").write_bytes(b"x")
    with pytest.raises(InputError, match="is open in another program"):
        read_correspondences(path, (A, B))
    (tmp_path / "d.db-wal").unlink()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError, match="is a damaged SQLite database"):
        read_correspondences(path, (A, B))
    path.write_bytes(content)
    read_correspondences(path, (A, B))
    assert sorted(place.name for place in tmp_path.iterdir()) == ["d.db"]
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"keypoints0": SCENE.uv1, "keypoints1": SCENE.uv2}, "nothing says which match"),
        ({"mkpts0": SCENE.uv1, "mkpts1": SCENE.uv2[1:]}, "269 in mkpts1; needed a row a match"),
        ({"mkpts0": SCENE.uv1.T, "mkpts1": SCENE.uv2.T}, "has the shape (2, 270), needed (n, 2)"),
        ({"kpts0": SCENE.uv1, "kpts1": SCENE.uv2, "matches": np.zeros(9, int)}, "has 9 entries for 270 keypoints"),
        ({"kpts0": SCENE.uv1, "kpts1": SCENE.uv2, "matches": np.full((3, 2), 300)}, "names keypoint 300 of kpts0"),
        ({"kpts0": SCENE.uv1, "kpts1": SCENE.uv2, "matches": np.full((3, 2), 0.5)}, "has no whole numbers"),
        ({"descriptors": SCENE.uv1, "scores": SCENE.uv2}, "has no points under a known name (found 'descriptors'"),
        ({"a": np.zeros((9, 3))}, "has the shape (9, 3), needed (n, 4)"),
        ({"a": np.array([[0, 0, 0, np.nan]])}, "correspondence 1 is (0, 0, 0, nan)"),
        ({"a": np.array(["x"])}, "shape (1,)"),
        ({"mkpts0": np.array([{}]), "mkpts1": SCENE.uv2}, "is no NumPy array of numbers"),
        ({"pts1": SCENE.uv1, "pts2": SCENE.uv2, "patch": np.full(270, 0.5)}, "patch is 0.5"),
        ({"pts1": SCENE.uv1, "pts2": SCENE.uv2, "sigma": np.zeros(270)}, "a sigma is not from"),
        ({"pts1": SCENE.uv1, "pts2": SCENE.uv2, "sigma": np.ones(9)}, "sigma has the shape (9,), needed (270,)"),
    ],
)
def test_archives_that_are_not_what_they_seem(arrays: dict[str, Any], said: str, tmp_path: Path) -> None:
    path = tmp_path / "m.npz"
    path.write_bytes(archive(**arrays))
    with pytest.raises(InputError) as refused:
        read_correspondences(path)
    assert said in str(refused.value)


def test_an_archive_may_say_planes_and_sigmas(tmp_path: Path) -> None:
    sigma = np.linspace(0.1, 1.0, len(SCENE.uv1))
    (tmp_path / "m.npz").write_bytes(archive(pts1=SCENE.uv1, pts2=SCENE.uv2, patch=SCENE.patch, sigma=sigma))
    given = read_correspondences(tmp_path / "m.npz")
    assert given.has_patch
    assert np.array_equal(given.patch, SCENE.patch)
    assert np.array_equal(given.sigma, sigma)


def test_hdf5_files_that_are_not_what_they_seem(tmp_path: Path) -> None:
    import h5py

    points, pairs = points_and_pairs()
    matches, features = hloc_files(tmp_path, points, pairs)
    with pytest.raises(InputError, match="give the file with the keypoints as --keypoints"):
        read_correspondences(matches, (A, B))
    with pytest.raises(InputError, match="are both of one run"):
        read_correspondences(features, (A, B), features)
    with pytest.raises(InputError, match="has no keypoints of images"):
        read_correspondences(matches, (A, B), matches)
    with h5py.File(features, "r+") as file:
        for name in (A, B):
            xy = file[name]["keypoints"][:]
            del file[name]["keypoints"]
            file[name]["keypoints"] = xy.astype("f2")
    half = read_correspondences(matches, (A, B), features)
    assert "its keypoints have 16 bits each" in half.note
    assert np.abs(sorted_rows(half)[:, 3] - expected()[:, 3]).max() < 0.6
    with h5py.File(features, "r+") as file:
        del file[A]["keypoints"]
        file[A]["keypoints"] = h5py.ExternalLink("other.h5", "/x")
    with pytest.raises(InputError, match="has no matches of"):
        read_correspondences(matches, (A, B), features)
    features.write_bytes(features.read_bytes()[:999])
    with pytest.raises(InputError, match="is no HDF5 file, or a damaged one"):
        read_correspondences(matches, (A, B), features)


def test_without_h5py_one_line_says_how_to_get_it(tmp_path: Path, ask: Ask, monkeypatch: pytest.MonkeyPatch) -> None:
    matches, features = hloc_files(tmp_path, *points_and_pairs())
    load = builtins.__import__

    def without(name: str, *rest: Any, **others: Any) -> Any:
        if name == "h5py":
            raise ImportError(name)
        return load(name, *rest, **others)

    monkeypatch.setattr(builtins, "__import__", without)
    status, out, err = ask(matches, "--keypoints", features, "--pair", A, B)
    assert (status, out, len(err.splitlines())) == (1, "", 1)
    assert "needs h5py; run pip install 'slopemap[h5]'" in err


def test_options_of_files_with_several_pairs_are_refused_for_others(tmp_path: Path, ask: Ask) -> None:
    np.savetxt(tmp_path / "m.txt", np.hstack([SCENE.uv1, SCENE.uv2]))
    assert "holds one pair with its points; leave --pair out" in ask(tmp_path / "m.txt", "--pair", A, B)[2]
    assert "leave --keypoints out" in ask(tmp_path / "m.txt", "--keypoints", "k.h5")[2]


# ---- which rows lie on one plane ----


@pytest.fixture
def rows(tmp_path: Path) -> Path:
    """The scene's rows without a word about planes; those on no plane are left out."""
    on = SCENE.patch >= 0
    np.savetxt(tmp_path / "m.txt", np.hstack([SCENE.uv1[on], SCENE.uv2[on]]), fmt="%.9g")
    return tmp_path / "m.txt"


def camera() -> tuple[str, str, str, str]:
    one = SCENE.camera
    return "--intrinsics", f"{one.fx},{one.fy},{one.cx},{one.cy}", "--size", f"{one.width}x{one.height}"


def truth_at(polygon: list[list[float]]) -> float:
    """Slope of the scene's plane whose points lie in a polygon, deg."""
    low, high = np.min(polygon, axis=0) - 0.01, np.max(polygon, axis=0) + 0.01
    inside = ((SCENE.uv1 >= low) & (SCENE.uv1 <= high)).all(axis=1) & (SCENE.patch >= 0)
    (number,) = set(SCENE.patch[inside])
    return float(np.degrees(SCENE.slopes[number]))


def test_a_grid_a_plane_in_each_part(rows: Path, ask: Ask) -> None:
    status, out, _ = ask(rows, *camera(), "--grid", "3x3", "--json", "--noise", "0.2")
    assert status == 0
    result = json.loads(out)
    assert [plane["id"] for plane in result["planes"]] == list(range(1, 10))
    for plane in result["planes"]:
        assert abs(plane["slope_deg"] - truth_at(plane["polygon_px"])) < 4 * plane["slope_sigma_deg"]
    assert (result["options"]["planes"], result["options"]["grid"]) == ("windows", [3, 3])


def test_windows_keep_their_numbers_and_one_without_rows_is_named(rows: Path, ask: Ask) -> None:
    status, out, err = ask(rows, *camera(), "--window", "0,0,341,341", "--window", "0,1000,20,20", "--json")
    assert status == 0
    result = json.loads(out)
    (rejected,) = result["rejected"]
    assert (rejected["id"], rejected["reason"]) == (2, "too-few-points")
    assert "no row lies in it" in rejected["message"]
    assert rejected["polygon_px"][0] == [-0.5, 999.5]
    status, _, err = ask(rows, *camera(), "--window", "0,0,400,400", "--window", "0,0,300,300")
    assert status == 1
    assert "lies in windows 1 and 2" in err


def test_planes_found_among_rows(rows: Path, tmp_path: Path, ask: Ask) -> None:
    """Most rows are on planes of one of the scene each; with lens distortion, and as rays, too."""
    arguments = ("--planes", "found", "--json", "--noise", "0.2")
    status, out, _ = ask(rows, *camera(), *arguments)
    assert status == 0
    result = json.loads(out)
    assert len(result["planes"]) >= 7
    good = [
        plane
        for plane in result["planes"]
        if min(abs(plane["slope_deg"] - slope) for slope in np.degrees(SCENE.slopes)) < 4 * plane["slope_sigma_deg"]
    ]
    assert len(good) >= len(result["planes"]) - 1
    assert (result["options"]["planes"], result["options"]["seed"]) == ("found", 0)
    assert ask(rows, *camera(), *arguments)[1] == out
    on = SCENE.patch >= 0
    np.savetxt(tmp_path / "rays.txt", np.hstack([SCENE.x1[on], SCENE.x2[on]]), fmt="%.12g")
    rays = json.loads(ask(tmp_path / "rays.txt", "--planes", "found", "--json")[1])
    assert len(rays["planes"]) == pytest.approx(len(result["planes"]), abs=2)


def test_mismatches_on_none_of_the_planes_found_do_not_spoil_the_motion(tmp_path: Path, ask: Ask) -> None:
    on = SCENE.patch >= 0
    table = np.hstack([SCENE.uv1[on], SCENE.uv2[on]])
    np.savetxt(tmp_path / "m.txt", table, fmt="%.9g")
    mismatches = np.random.default_rng(3).uniform(100.0, 900.0, (5, 4))
    np.savetxt(tmp_path / "w.txt", np.vstack([table, mismatches]), fmt="%.9g")
    arguments = ("--planes", "found", "--json", "--noise", "0.2")
    plain, wrong = (json.loads(ask(tmp_path / name, *camera(), *arguments)[1]) for name in ("m.txt", "w.txt"))
    assert len(wrong["planes"]) == pytest.approx(len(plain["planes"]), abs=1)
    for plane in wrong["planes"]:
        assert min(abs(plane["slope_deg"] - slope) for slope in np.degrees(SCENE.slopes)) < 4 * plane["slope_sigma_deg"]
        assert plane["slope_sigma_deg"] < 2.0
    assert "on none of the planes found" in ask(tmp_path / "w.txt", *camera(), *arguments)[2]


def test_no_plane_found_is_no_answer(tmp_path: Path, ask: Ask) -> None:
    np.savetxt(tmp_path / "m.txt", np.random.default_rng(0).uniform(-0.4, 0.4, (40, 4)))
    status, out, err = ask(tmp_path / "m.txt", "--planes", "found")
    assert (status, out) == (3, "")
    assert "none of the 40 rows" in err


def test_ways_to_give_planes_that_contradict(rows: Path, tmp_path: Path, ask: Ask) -> None:
    table = np.column_stack([SCENE.uv1, SCENE.uv2, SCENE.patch])
    np.savetxt(tmp_path / "p.txt", table, fmt="%.9g")
    for arguments, said in (
        (("--planes", "one", "--grid", "2x2"), "contradict each other"),
        (("--seed", "3"), "--seed is of --planes found"),
        (("--labels", "x.png", "--planes", "found"), "contradict each other"),
    ):
        status, _, err = ask(rows, *camera(), *arguments)
        assert status == 2
        assert said in err
    status, _, err = ask(tmp_path / "p.txt", *camera(), "--planes", "one")
    assert status == 2
    assert "--planes contradicts the column patch" in err
    status, _, err = ask(rows, "--grid", "2x2")
    assert status == 2
    assert "there is no camera" in err
    status, _, err = ask(rows, *camera()[:2], "--grid", "2x2")
    assert status == 2
    assert "add --size" in err


def test_a_label_image_must_be_one_of_image_1(rows: Path, tmp_path: Path, ask: Ask) -> None:
    for name, pixels, said in (
        ("small.png", np.zeros((64, 64), np.uint16), "is 64x64 px, and image 1 of the camera is 1024x1024"),
        ("colour.png", np.zeros((64, 64, 3), np.uint8), "has 3 channels of uint8, needed one of whole numbers"),
        ("real.tif", np.zeros((64, 64), np.float32), "has 1 channel of float32, needed one of whole numbers"),
    ):
        cv2.imwrite(str(tmp_path / name), pixels)
        status, _, err = ask(rows, *camera(), "--labels", tmp_path / name)
        assert (status, len(err.splitlines())) == (1, 1)
        assert said in err
