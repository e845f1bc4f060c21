"""`slopemap map`, from two images to files: right where the truth is known, the same every time, refusals of one line.

Most runs are on the descent sample shrunk to half its size, which is matched and solved once for each set of options.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from command import Done, slopemap
from jsonschema import Draft202012Validator
from output_names import files_of
from remembered import forget
from scenery import Pair, Surface, make_camera, render, tilted, turn, unit

from slopecli.errors import InputError
from slopecli.geometry import pixels_from_rays
from slopecli.ground import SlopeMap
from slopecli.io import load_image, load_schema, write_map, write_outputs
from slopecli.io.cameras import load_camera
from slopecli.options import Lander, MapOptions, Options
from slopecli.pipeline import estimate, slope_map
from slopecli.products import BANDS, MAP_PRODUCTS, NODATA
from slopecli.types import Camera, FloatArray, Image

FOLDER = Path(__file__).resolve().parent.parent / "sample_data" / "descent"
TRUTH = json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))
BASELINE_M = float(np.linalg.norm(TRUTH["T"]))
IMAGE1, IMAGE2 = (load_image(FOLDER / f"image{number}.png") for number in (1, 2))
CAMERA = load_camera(FOLDER / "camera.json", size=(800, 800))
HALF_CAMERA = {"width": 400, "height": 400, "fx": 346.41016151, "fy": 346.41016151, "cx": 199.5, "cy": 199.5}
LENS = {"distortion": [-0.06, 0.012, 0.0, 0.0, 0.0]}
ALWAYS = files_of(MAP_PRODUCTS, without=("pictures",))
BACKWARD = unit(0.3, -0.2, -0.9)

pytestmark = pytest.mark.usefixtures("_solved_once")


def image_of(grey: np.ndarray, name: str = "image.png") -> Image:
    return replace(IMAGE1, grey=grey, path=name, sha256="0" * 64, colour=None)


@pytest.fixture(scope="module")
def half(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sample at half its size: 1.png, 2.png, camera.json."""
    folder = tmp_path_factory.mktemp("half")
    for number, image in ((1, IMAGE1), (2, IMAGE2)):
        small = cv2.resize(image.grey, (400, 400), interpolation=cv2.INTER_AREA)
        cv2.imwrite(str(folder / f"{number}.png"), small)
    (folder / "camera.json").write_text(json.dumps({**HALF_CAMERA, **LENS}))
    return folder


def run(half: Path, *options: str, out: Path | None = None, camera: str = "camera.json") -> Done:
    where = ("--json",) if out is None else ("-o", str(out))
    pair = (str(half / "1.png"), str(half / "2.png"), "--camera", str(half / camera))
    return slopemap("map", *pair, *options, *where)


def answered(half: Path, *options: str, out: Path | None = None) -> Any:
    done = run(half, *options, out=out)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout if out is None else (out / "slopes.json").read_text())


@pytest.fixture(scope="module")
def plain(half: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Done, Path]:
    """The ordinary run, with a scale."""
    folder = tmp_path_factory.mktemp("plain")
    done = run(half, "--baseline", str(BASELINE_M), out=folder)
    assert done.returncode == 0, done.stderr
    return done, folder


# ---- right ----


@lru_cache(maxsize=1)
def wide_footprints() -> SlopeMap:
    """The sample with footprints as large as the windows of smooth ground that the truth has."""
    wanted = MapOptions(footprint_px=140.0, spacing_px=8)
    return slope_map(IMAGE1, IMAGE2, CAMERA, CAMERA, Options(baseline_m=BASELINE_M), wanted)


@pytest.mark.parametrize("window", TRUTH["smooth_windows"], ids=lambda window: window["id"])
def test_slopes_and_distances_of_the_sample_are_right_within_their_sigmas(window: dict[str, Any]) -> None:
    answer = wide_footprints()
    u, v = (window[a] + window[b] / 2 - 0.5 for a, b in (("x", "w"), ("y", "h")))
    row, column = (round((at + 0.5) / 8 - 0.5) for at in (v, u))
    if not answer.known[row, column]:
        pytest.skip("image 2 does not show all of it")
    off = abs(answer.slope_deg[row, column] - window["slope_deg"])
    assert off < 3 * answer.sigma_deg[row, column] + 0.5  # a disc is not a square
    normal = -np.array(window["normal_cam1"])
    at = answer.points[row, column]
    assert normal @ at == pytest.approx(window["distance_m"], rel=0.01)
    assert np.linalg.norm(at) == pytest.approx(answer.distance[row, column])


def test_the_sample_is_mostly_known_and_its_sigmas_are_worth_having() -> None:
    answer = wide_footprints()
    assert answer.known.mean() > 0.6  # of a wide footprint all must be in the image
    assert np.median(answer.sigma_deg[answer.known]) < 1.0


@lru_cache(maxsize=1)
def two_planes() -> tuple[Pair, SlopeMap]:
    """Level ground and a slope of 20 degrees beside it, joined along a line of image 1."""
    level, tangent = tilted(0, 0, 6.0), np.tan(np.radians(20))
    x0 = (160 - 159.5) / make_camera().fx  # the ray of the line where both have the same depth
    steep = np.array([tangent, 0.0, 1.0 - tangent * x0]) / 6.0
    pair = render(turn(0.5, -0.3, 1), BACKWARD, [level, Surface(steep, (160, 0, 160, 240))])
    first, second = image_of(pair.grey1, "1.png"), image_of(pair.grey2, "2.png")
    wanted = MapOptions(footprint_px=30.0, spacing_px=6)
    return pair, slope_map(first, second, pair.camera1, pair.camera2, Options(grid=(2, 1)), wanted)


def cells_apart(answer: SlopeMap) -> tuple[FloatArray, FloatArray]:
    """Masks of the cells on the level ground, and of those on the slope."""
    u = (np.arange(answer.slope_deg.shape[1]) + 0.5) * answer.spacing_px - 0.5
    left, right = (np.broadcast_to(side, answer.slope_deg.shape) for side in (u < 142, u > 178))
    return np.asarray(left & answer.known), np.asarray(right & answer.known)


def test_cells_of_two_planes_have_their_slopes_within_their_sigmas() -> None:
    _, answer = two_planes()
    for where, slope in zip(cells_apart(answer), (0.0, 20.0), strict=True):
        assert where.sum() > 200
        off = np.abs(answer.slope_deg - slope)[where]
        assert np.median(off) < 1.0
        assert (off < 3 * answer.sigma_deg[where]).mean() > 0.95


def test_the_level_ground_is_safe_and_the_slope_is_not_and_its_aspect_is_downhill() -> None:
    _, answer = two_planes()
    level, steep = cells_apart(answer)
    verdicts = answer.verdicts
    assert (verdicts[level] == "safe").mean() > 0.95
    assert (verdicts[steep] == "unsafe").mean() > 0.95
    assert np.median(answer.aspect_deg[steep]) == pytest.approx(270.0, abs=2.0)  # nearer to the right, so higher


def test_a_site_lies_on_the_level_ground_and_both_cameras_see_it_where_it_says() -> None:
    pair, answer = two_planes()
    best = answer.sites[0]
    assert best.centre_px[0] + best.radius_px < 185
    assert best.radius_px > 50
    seen = pair.transfer(np.array([best.centre_px]))[0]
    assert best.centre_image2_px == pytest.approx(tuple(seen), abs=0.5)
    for direction, camera, px in (
        (best.direction_cam1, pair.camera1, best.centre_px),
        (best.direction_cam2, pair.camera2, best.centre_image2_px),
    ):
        assert direction is not None
        ray = np.array(direction)[None]
        assert pixels_from_rays(camera, ray[:, :2] / ray[:, 2:])[0] == pytest.approx(px, abs=0.6)


def test_options_change_the_answer_as_they_say() -> None:
    pair, answer = two_planes()
    first, second = image_of(pair.grey1, "1.png"), image_of(pair.grey2, "2.png")
    level, steep = cells_apart(answer)
    wanted = MapOptions(footprint_px=30.0, spacing_px=6, sites=0)
    gentler = slope_map(first, second, pair.camera1, pair.camera2, Options(grid=(2, 1), tolerance_deg=30.0), wanted)
    assert (gentler.verdicts[steep] == "safe").mean() > 0.95
    assert gentler.sites == ()
    assert gentler.no_site == ""
    up = (np.sin(np.radians(20)), 0.0, -np.cos(np.radians(20)))
    turned = slope_map(first, second, pair.camera1, pair.camera2, Options(grid=(2, 1), up=up), wanted)
    assert np.median(turned.slope_deg[level]) == pytest.approx(20.0, abs=0.7)
    vague = slope_map(
        first, second, pair.camera1, pair.camera2, Options(grid=(2, 1), up=(0.0, 0.0, -1.0), up_sigma_deg=4.0), wanted
    )
    assert np.median(vague.sigma_deg[steep]) == pytest.approx(4.0, rel=0.1)
    assert (vague.verdicts[steep] == "undecided").mean() > 0.95


# ---- files ----


def test_files_and_table_are_complete(plain: tuple[Done, Path]) -> None:
    done, folder = plain
    assert {path.name for path in folder.iterdir()} == files_of(MAP_PRODUCTS)
    assert all(name in done.stderr for name in files_of(MAP_PRODUCTS))
    header, *rows = done.stdout.splitlines()
    assert header.split()[0] == "site"
    assert 1 <= len(rows) <= 5
    assert " m" in rows[0]
    assert "% safe" in done.stderr


def test_json_is_valid_under_the_schema_it_names(plain: tuple[Done, Path]) -> None:
    result = json.loads((plain[1] / "slopes.json").read_text())
    Draft202012Validator(load_schema(result["schema_version"])).validate(result)
    Draft202012Validator(load_schema()).validate(result)
    assert {"map", "sites"} <= set(result)


def test_the_tiff_is_what_json_and_table_say(plain: tuple[Done, Path]) -> None:
    done, folder = plain
    result = json.loads((folder / "slopes.json").read_text())
    bands = dict(zip(BANDS, tifffile.imread(folder / "slope_map.tif"), strict=True))
    told = result["map"]
    assert (told["file"], tuple(told["bands"])) == ("slope_map.tif", BANDS)
    assert bands["slope_deg"].shape == (400 // told["spacing_px"], 400 // told["spacing_px"])
    known = bands["slope_deg"] != NODATA
    assert known.mean() == pytest.approx(told["valid_share"])
    confidence = result["options"]["confidence"]
    shares = {
        "safe": known & (bands["p_safe"] >= confidence),
        "unsafe": known & (bands["p_safe"] <= 1 - confidence + 1e-7),
        "unknown": ~known,
    }
    for name, where in shares.items():
        assert where.mean() == pytest.approx(told["area_share"][name], abs=1e-3)
    assert sum(told["area_share"].values()) == pytest.approx(1.0)
    for site, row in zip(result["sites"], done.stdout.splitlines()[1:], strict=True):
        u, v = site["centre_px"]
        column, line = (round((at + 0.5) / told["spacing_px"] - 0.5) for at in (u, v))
        assert bands["p_safe"][line, column] >= confidence
        assert row.split()[0] == str(site["id"])
        assert f"{site['slope_deg']:.2f}" in row


def test_the_same_images_give_the_same_bytes(plain: tuple[Done, Path], half: Path, tmp_path: Path) -> None:
    forget()
    answered(half, "--baseline", str(BASELINE_M), out=tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {path.name for path in plain[1].iterdir()}
    for path in plain[1].iterdir():
        assert path.read_bytes() == (tmp_path / path.name).read_bytes(), path.name


def test_json_on_stdout_is_that_of_the_file(plain: tuple[Done, Path], half: Path) -> None:
    assert answered(half, "--baseline", str(BASELINE_M)) == json.loads((plain[1] / "slopes.json").read_text())


def test_pictures_are_left_out_and_a_cloud_is_added_on_request_and_files_of_an_estimate_go(
    half: Path, tmp_path: Path
) -> None:
    pair = (str(half / "1.png"), str(half / "2.png"), "--camera", str(half / "camera.json"))
    assert slopemap("estimate", *pair, "-o", str(tmp_path)).returncode == 0
    (tmp_path / "notes.txt").write_text("mine")
    answered(half, "--no-pictures", "--ply", out=tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == ALWAYS | {"cloud.ply", "notes.txt"}
    assert slopemap("estimate", *pair, "-o", str(tmp_path)).returncode == 0
    assert {path.name for path in tmp_path.iterdir()} == files_of() | {"notes.txt"}


def test_a_program_writes_the_same_files(half: Path, tmp_path: Path, plain: tuple[Done, Path]) -> None:
    first, second = load_image(half / "1.png"), load_image(half / "2.png")
    camera = load_camera(half / "camera.json")
    answer = slope_map(first, second, camera, camera, Options(baseline_m=BASELINE_M))
    written = write_map(answer, first, tmp_path)
    assert written[0].name == "slopes.json"
    assert (tmp_path / "slope_map.tif").read_bytes() == (plain[1] / "slope_map.tif").read_bytes()
    report = estimate(first, second, camera, camera, Options(baseline_m=BASELINE_M))
    assert np.array_equal(report.motion.baseline_cam1, answer.report.motion.baseline_cam1)
    for plane, through_matches in zip(report.planes, answer.report.planes, strict=True):
        # the same planes, but where those through all pixels tell more
        assert abs(plane.slope_deg - through_matches.slope_deg) < 3.0 * (plane.slope_sigma_deg or 0.0)
    write_outputs(report, first, tmp_path)
    assert not (tmp_path / "slope_map.tif").exists()


# ---- options ----


def test_a_footprint_in_metres_is_that_of_as_many_pixels(half: Path) -> None:
    scale = ("--baseline", str(BASELINE_M))
    pixels = answered(half, "--footprint", "40", *scale)["map"]
    metres = answered(half, "--footprint-m", f"{pixels['footprint']:.9f}", *scale)["map"]
    assert metres["footprint_px"] == pytest.approx(40.0, rel=0.03)  # the medians of pixels and of matches differ
    assert metres["area_share"]["safe"] == pytest.approx(pixels["area_share"]["safe"], abs=0.05)


def test_sites_are_as_many_and_as_large_as_asked_for(half: Path) -> None:
    assert answered(half, "--sites", "0")["sites"] == []
    sites = answered(half, "--site-radius", "22", "--sites", "3")["sites"]  # without it there are five
    assert [site["radius_px"] for site in sites] == [22.0] * 3
    assert sites == sorted(sites, key=lambda site: -site["p_safe"])
    done = run(half, "--site-radius", "190")
    assert done.returncode == 0
    assert "no landing site: the largest disc of safe ground" in done.stderr


def test_without_a_scale_it_is_said_that_the_lander_counts_in_baselines(half: Path) -> None:
    done = run(half, "--lander", "4,0.5", "--max-height", "0.2")
    assert "--lander and --max-height count in baselines" in done.stderr
    assert "count in baselines" not in run(half, "--lander", "4,0.5", "--baseline", str(BASELINE_M)).stderr


def test_a_lander_sets_the_footprint_and_how_it_stands_is_told(half: Path) -> None:
    scale = ("--baseline", str(BASELINE_M))
    result = answered(half, "--lander", "4,1.2,0.3", *scale)
    assert result["map"]["footprint"] == pytest.approx(1.5, rel=0.05)
    for site in result["sites"]:
        assert site["radius"] >= 0.75
        assert 0 <= site["lander_slope_deg"] <= 15
        assert site["lander_clearance"] >= 0
    assert all(site["lander_slope_deg"] is None for site in answered(half, *scale)["sites"])


def test_a_limit_of_height_makes_less_ground_safe(half: Path) -> None:
    scale = ("--baseline", str(BASELINE_M))
    limit = lambda *height: answered(half, *scale, *height)["map"]["area_share"]["safe"]  # noqa: E731
    assert limit() > limit("--max-height", "0.25") > 0


def test_classes_are_drawn_and_change_no_number(half: Path, plain: tuple[Done, Path], tmp_path: Path) -> None:
    answered(half, "--baseline", str(BASELINE_M), "--classes", "4,8,15,40", out=tmp_path)
    assert (tmp_path / "slope_map.tif").read_bytes() == (plain[1] / "slope_map.tif").read_bytes()
    assert (tmp_path / "map.png").read_bytes() != (plain[1] / "map.png").read_bytes()


def test_cells_may_be_a_pixel_apart(half: Path, tmp_path: Path) -> None:
    for number in (1, 2):
        grey = cv2.imread(str(half / f"{number}.png"), cv2.IMREAD_GRAYSCALE)
        cv2.imwrite(str(tmp_path / f"{number}.png"), cv2.resize(grey, (200, 200), interpolation=cv2.INTER_AREA))
    camera = {
        name: (value + 0.5) / 2 - 0.5 if name in ("cx", "cy") else value / 2 for name, value in HALF_CAMERA.items()
    }
    camera |= {"width": 200, "height": 200}
    (tmp_path / "camera.json").write_text(json.dumps({**camera, **LENS}))
    out = tmp_path / "out"
    assert answered(tmp_path, "--spacing", "1", "--footprint", "20", "--no-pictures", out=out)["map"]["spacing_px"] == 1
    assert tifffile.imread(out / "slope_map.tif").shape == (9, 200, 200)


def test_the_largest_plane_may_be_level(half: Path) -> None:
    result = answered(half, "--up", "dominant-plane")
    assert result["up"]["source"] == "dominant-plane"
    assert result["up"]["plane_id"] is not None


# ---- caution ----


def test_a_camera_that_is_suspected_leaves_nothing_safe_and_the_reason_is_said(half: Path, tmp_path: Path) -> None:
    wrong = {**HALF_CAMERA, "fx": 1.1 * HALF_CAMERA["fx"], "fy": 1.1 * HALF_CAMERA["fy"]}
    (half / "wrong.json").write_text(json.dumps({**wrong, **LENS}))
    done = run(half, out=tmp_path, camera="wrong.json")
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "slopes.json").read_text())
    assert "suspect-camera" in {one["code"] for one in result["diagnostics"]}
    assert (result["map"]["area_share"]["safe"], result["sites"]) == (0.0, [])
    chance = tifffile.imread(tmp_path / "slope_map.tif")[BANDS.index("p_safe")]
    assert 0.0 < chance.max() <= 0.5
    assert "no landing site: nothing is called safe as long as there is the warning suspect-camera" in done.stderr
    assert done.stdout == "no landing site\n"


def test_a_vertical_in_doubt_leaves_less_safe(half: Path) -> None:
    up = ("--up", "0,0,-1")
    sure, vague = (answered(half, *up, "--up-sigma", sigma) for sigma in ("0", "3"))
    assert vague["map"]["area_share"]["safe"] < sure["map"]["area_share"]["safe"]
    assert vague["map"]["area_share"]["undecided"] > sure["map"]["area_share"]["undecided"]


# ---- refusals ----

REFUSED = {
    "height": (("--baseline", "2.175", "--max-height", "0.01"), 1, "--max-height 0.01 m cannot be promised: at 0.03"),
    "height without scale": (("--max-height", "0.001"), 1, "--max-height 0.001 baselines cannot be promised"),
    "metres without scale": (("--footprint-m", "1"), 1, "--footprint-m needs a scale; give --baseline, --altitude or"),
    "wide footprint": (("--footprint", "300"), 1, "it must be between 12 and 200 px (400x400 px)"),
    "narrow footprint": (("--footprint", "5"), 1, "it must be between 12 and 200 px"),
    "wide lander": (("--baseline", "2.175", "--lander", "3,20"), 1, "it must be between 12 and 200 px"),
    "spacing": (("--spacing", "500"), 1, "cells 500 px apart leave none in an image of 400x400 px"),
}


@pytest.mark.parametrize(("options", "status", "told"), REFUSED.values(), ids=REFUSED)
def test_what_the_pixels_cannot_serve_is_refused_in_one_line_with_the_limit(
    options: tuple[str, ...], status: int, told: str, half: Path, tmp_path: Path
) -> None:
    done = run(half, *options, out=tmp_path / "out")
    assert (done.returncode, done.stdout) == (status, ""), done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("slopemap: error: ")
    assert told in line
    assert not (tmp_path / "out").exists()


def test_the_limit_that_is_offered_is_accepted(half: Path) -> None:
    scale = ("--baseline", "2.175", "--confidence", "0.9")
    line = run(half, *scale, "--max-height", "0.01").stderr
    pixel, least = (float(line.split(before)[1].split()[0].rstrip(",;")) for before in (" at ", "give at least "))
    assert least == pytest.approx(pixel * (0.7 + 2 * 1.2816), rel=0.01)
    assert run(half, *scale, "--max-height", f"{least:g}").returncode == 0


USAGE = {
    "two footprints": (("--footprint", "30", "--footprint-m", "1"), "--footprint and --footprint-m contradict"),
    "no footprint": (("--footprint", "0"), "'--footprint'"),
    "no spacing": (("--spacing", "0"), "'--spacing'"),
    "sites": (("--sites", "-1"), "'--sites'"),
    "two pads": (("--lander", "2,3"), "'--lander'"),
    "half a lander": (("--lander", "4"), "'--lander'"),
    "classes": (("--classes", "20,10"), "'--classes'"),
    "windows": (("--grid", "2x2"), "--grid"),
}


@pytest.mark.parametrize(("options", "told"), USAGE.values(), ids=USAGE)
def test_usage_errors_name_the_option(options: tuple[str, ...], told: str, half: Path, tmp_path: Path) -> None:
    done = run(half, *options, out=tmp_path / "out")
    assert (done.returncode, done.stdout) == (2, "")
    assert told in done.stderr
    assert not (tmp_path / "out").exists()


def scene_without_answer(name: str) -> tuple[np.ndarray, np.ndarray, Camera]:
    if name == "pure rotation":
        pair = render(turn(1, 2, 3), unit(1, 0, 0), [tilted(0, 0, 1e6)])
    elif name == "identical":
        pair = render(turn(), unit(1, 0, 0), [tilted(0, 0)])
        return pair.grey1, pair.grey1, pair.camera1
    else:
        pair, other = (
            render(turn(), unit(1, 0, 0), [tilted(0, 0)], camera1=make_camera(160, 120), seed=seed) for seed in (0, 5)
        )
        return pair.grey1, other.grey2, pair.camera1
    return pair.grey1, pair.grey2, pair.camera1


@pytest.mark.parametrize("name", ["pure rotation", "identical", "no overlap"])
def test_pairs_without_an_answer_end_as_those_of_an_estimate(name: str, tmp_path: Path) -> None:
    *greys, camera = scene_without_answer(name)
    paths = [str(tmp_path / f"{number}.png") for number in (1, 2)]
    for path, grey in zip(paths, greys, strict=True):
        cv2.imwrite(path, grey)
    by_hand = ",".join(str(value) for value in (camera.fx, camera.fy, camera.cx, camera.cy))
    ends = [
        slopemap(command, *paths, "--intrinsics", by_hand, "-o", str(tmp_path / "out"))
        for command in ("estimate", "map")
    ]
    assert [(done.returncode, done.stdout) for done in ends] == [(ends[0].returncode, "")] * 2
    assert ends[0].returncode in (1, 3)
    assert ends[0].stderr == ends[1].stderr
    assert len(ends[1].stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_failed_run_leaves_the_earlier_answer(plain: tuple[Done, Path], half: Path) -> None:
    before = {path.name: path.read_bytes() for path in plain[1].iterdir()}
    assert run(half, "--footprint", "300", out=plain[1]).returncode == 1
    assert {path.name: path.read_bytes() for path in plain[1].iterdir()} == before


def test_an_image_is_not_replaced_by_a_file_of_the_answer(half: Path, tmp_path: Path) -> None:
    (tmp_path / "map.png").write_bytes((half / "1.png").read_bytes())
    pair = (str(tmp_path / "map.png"), str(half / "2.png"), "--camera", str(half / "camera.json"))
    done = slopemap("map", *pair, "-o", str(tmp_path))
    assert done.returncode == 1
    assert "map.png is an input" in done.stderr
    assert {path.name for path in tmp_path.iterdir()} == {"map.png"}


def test_a_program_gets_the_same_refusals() -> None:
    pair, _ = two_planes()
    first, second = image_of(pair.grey1, "1.png"), image_of(pair.grey2, "2.png")
    with pytest.raises(InputError, match="--footprint-m needs a scale"):
        slope_map(first, second, pair.camera1, pair.camera2, Options(), MapOptions(footprint_m=1.0))
    tall = MapOptions(lander=Lander(3, 100.0))
    with pytest.raises(InputError, match="must be between"):
        slope_map(first, second, pair.camera1, pair.camera2, Options(), tall)


def test_nothing_is_safe_beside_ground_that_may_drop() -> None:
    """Level ground beside a slope has a hole in the middle without texture, so nobody knows how deep it is."""
    slope = Surface(tilted(0.5, 0.0), (230.0, 0.0, 90.0, 240.0))
    hole = Surface(tilted(0.0, 0.0, 9.0), (100.0, 90.0, 60.0, 60.0), contrast=0.0)
    pair = render(turn(1, -2, 3), unit(0.8, 0.2, 0.4), [Surface(tilted(0.0, 0.0)), slope, hole])
    images = image_of(pair.grey1), image_of(pair.grey2)
    result = slope_map(*images, pair.camera1, pair.camera2, Options(), MapOptions(footprint_px=32.0, spacing_px=4))
    u, v = np.meshgrid(*((np.arange(n) + 0.5) * 4 - 0.5 for n in result.p_safe.shape[::-1]))
    away = np.hypot(*(np.maximum(np.abs(one - middle) - 30.0, 0.0) for one, middle in ((u, 130.0), (v, 120.0))))
    assert not (result.verdicts[away < 16.0] == "safe").any()
    level = result.known & (away > 34.0) & (u < 200.0)
    assert (result.verdicts[level] == "safe").mean() > 0.85
