"""`--metadata`, the word exif and angles given: slopes against gravity, aspect from true north, lengths in metres."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from command import slopemap
from metadata_factory import FOCAL_35, PLACE, gimbal, photograph, xmp_packet
from numpy.testing import assert_allclose
from pyproj import Geod, Proj
from scenery import Pair, Surface, make_camera, render, turn, unit
from scipy.spatial.transform import Rotation

from slopecli.errors import InputError
from slopecli.io import load_schema
from slopecli.io.metadata import apply_metadata, read_metadata
from slopecli.options import CameraChoice, MetadataChoice, Options

R, T, BASELINE_M = turn(1, -2, 3), unit(0.8, 0.2, 0.4), 12.5
YAW, PITCH, ROLL = 130.0, -70.0, 5.0
CAMERA = make_camera()
LEFT, RIGHT = np.array([0.25, -0.3, 1.0]) / 6, np.array([-0.2, 0.35, 1.0]) / 5.5
HALVES = ("--window", "60,50,90,130", "--window", "180,50,90,130")
QUIET = ("--no-overlay", "--no-ply")
INTRINSICS = ("--intrinsics", f"{CAMERA.fx},{CAMERA.fy},{CAMERA.cx},{CAMERA.cy}")
BODY = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # x ahead, y right, z down of the camera's x right, y down, z ahead
NED_1 = Rotation.from_euler("ZYX", [YAW, PITCH, ROLL], degrees=True).as_matrix() @ BODY
METRES_NORTH, METRES_EAST = 111_180.0, 75_440.0  # of a degree at this latitude

pytestmark = pytest.mark.usefixtures("_solved_once")


@pytest.fixture(scope="module")
def scene() -> Pair:
    return render(R, T, [Surface(LEFT), Surface(RIGHT, (160, 0, 160, 240))], noise=1.0)


def angles_of(ned_from_camera: np.ndarray) -> dict[str, Any]:
    yaw, pitch, roll = Rotation.from_matrix(ned_from_camera @ BODY.T).as_euler("ZYX", degrees=True)
    return gimbal(yaw, pitch, roll)


def tags(number: int, **changes: Any) -> dict[str, Any]:
    """What DJI writes of image 1 or 2 of the scene; a change of None leaves a value out."""
    north, east, down = NED_1 @ T * BASELINE_M * (number - 1)
    values = {
        **angles_of(NED_1 if number == 1 else NED_1 @ R.T),
        "GpsLatitude": f"{PLACE[0] + north / METRES_NORTH:.9f}",
        "GpsLongitude": f"{PLACE[1] + east / METRES_EAST:.9f}",
        "AbsoluteAltitude": f"{412.0 - down:+.2f}",
        "RelativeAltitude": f"{60.0 - down:+.2f}",
        "DewarpData": f"2020-01-01;{CAMERA.fx},{CAMERA.fy},0,0,0,0,0,0,0",
        "DewarpFlag": "0",
        **changes,
    }
    return {name: value for name, value in values.items() if value is not None}


def write(folder: Path, scene: Pair, turns: tuple[int, int] = (0, 0), exif: Any = None, **changes: Any) -> list[str]:
    """Both images of the scene as files, each turned by quarters after its tags were written."""
    for number, grey, quarters in ((1, scene.grey1, turns[0]), (2, scene.grey2, turns[1])):
        packet = xmp_packet(tags(number, **changes))
        pixels = np.ascontiguousarray(np.rot90(grey, quarters))
        (folder / f"image{number}.jpg").write_bytes(photograph(pixels, exif, xmp=packet))
    return ["image1.jpg", "image2.jpg"]


def answer(folder: Path, images: list[str], *options: str, command: str = "estimate") -> dict[str, Any]:
    windows = HALVES if command == "estimate" else ()
    done = slopemap(command, *images, "--json", *windows, *options, cwd=folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def refused(folder: Path, *arguments: str, status: int = 1) -> str:
    done = slopemap("estimate", "image1.jpg", "image2.jpg", "--json", *arguments, cwd=folder)
    assert (done.returncode, done.stdout) == (status, "")
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("slopemap: error: ")] or [done.stderr]
    return line


def applied(folder: Path, images: list[str], choice: MetadataChoice, options: Options) -> Options:
    one, two = (read_metadata(folder / name) for name in images)
    of_image = CameraChoice(exif=True)
    return apply_metadata((one, two), choice, options, (of_image, of_image))


def codes(result: dict[str, Any]) -> dict[str, str]:
    return {one["code"]: one["message"] + (one["remedy"] or "") for one in result["diagnostics"]}


def truth(scaled_normal: np.ndarray) -> tuple[float, float, float]:
    """Slope against gravity, aspect from true north, degrees, and distance, m."""
    north, east, down = NED_1 @ (-scaled_normal / np.linalg.norm(scaled_normal))
    slope, aspect = np.degrees(np.arccos(-down)), np.degrees(np.arctan2(east, north)) % 360
    return float(slope), float(aspect), BASELINE_M / float(np.linalg.norm(scaled_normal))


def check_planes(result: dict[str, Any], aspect_atol: float = 1.5) -> None:
    for plane, normal in zip(result["planes"], (LEFT, RIGHT), strict=True):
        slope, aspect, distance = truth(normal)
        assert abs(plane["slope_deg"] - slope) < plane["slope_sigma_deg"] < 3
        assert_allclose(plane["aspect_deg"], aspect, atol=aspect_atol)
        if result["scale"]["unit"] == "m":
            assert_allclose(plane["distance"], distance, rtol=2 * result["scale"]["sigma"])


# ---- what is stated is used ----


def test_all_that_a_drone_states(tmp_path: Path, scene: Pair) -> None:
    result = answer(tmp_path, write(tmp_path, scene), "--metadata")
    check_planes(result)
    assert result["up"]["source"] == result["scale"]["source"] == "exif"
    assert result["up"]["sigma_deg"] == 1.0
    assert_allclose(result["up"]["vector_cam1"], -NED_1[2], atol=1e-4)
    assert_allclose(np.linalg.norm(result["motion"]["baseline_cam1"]), BASELINE_M, rtol=0.01)
    assert 0.05 < result["scale"]["sigma"] < 0.15
    assert result["cameras"][0]["source"].startswith("EXIF: DJI DewarpData")
    assert result["place"]["position"]["latitude_deg"] == PLACE[0]
    level = NED_1 @ [0, -1, 0]
    assert_allclose(result["place"]["heading_deg"], np.degrees(np.arctan2(level[1], level[0])) % 360, atol=0.01)
    assert "metadata-contradicted" not in codes(result)
    assert {"place"} <= set(load_schema()["required"])


def test_each_by_its_own_word(tmp_path: Path, scene: Pair) -> None:
    images = write(tmp_path, scene)
    words = ("--up", "exif", "--north", "exif", "--baseline", "exif", "--camera", "exif")
    whole, apart = answer(tmp_path, images, "--metadata"), answer(tmp_path, images, *words)
    assert [whole[key] for key in ("planes", "up", "scale")] == [apart[key] for key in ("planes", "up", "scale")]
    alone = answer(tmp_path, images, "--camera", "exif")
    assert (alone["up"]["source"], alone["scale"]["unit"]) == ("camera", "baseline")
    known = answer(tmp_path, images, "--metadata", "--baseline", "25", "--up", "0,0,-1", "--up-sigma", "2")
    assert (known["up"]["source"], known["up"]["sigma_deg"], known["scale"]["source"]) == ("given", 2.0, "baseline")


def test_angles_given_are_those_of_the_gimbal(tmp_path: Path, scene: Pair) -> None:
    images = write(tmp_path, scene, GimbalPitchDegree=None)
    given = ("--yaw", f"{YAW}", "--pitch", f"{PITCH}", "--roll", f"{ROLL}", "--camera", "exif")
    result = answer(tmp_path, images, *given)
    check_planes(result)
    assert result["up"]["source"] == "given"
    images = write(tmp_path, scene, GimbalRollDegree="+0.00")  # one is wrong, the others are as stated
    partly = answer(tmp_path, images, "--metadata", "--roll", f"{ROLL}")
    check_planes(partly)
    assert (partly["up"]["sigma_deg"], result["up"]["sigma_deg"]) == (1.0, 0.0)


def test_a_telephone_held_upright(tmp_path: Path, scene: Pair) -> None:
    """Pixels as the sensor has them, to be shown turned clockwise; the pitch is given, the heading stated."""
    grey = photograph(scene.grey1, {FOCAL_35: 24}, {0x10: "T", 0x11: 215.0}, {274: 6})
    (tmp_path / "image1.jpg").write_bytes(grey)
    one = read_metadata(tmp_path / "image1.jpg")
    options = apply_metadata((one, one), MetadataChoice(may=("up", "north"), pitch_deg=-30.0), Options())
    assert_allclose(options.up, (-np.cos(np.radians(30)), 0, -np.sin(np.radians(30))), atol=1e-9)  # its left is the top
    assert options.north is not None
    ahead = np.array([0, 0, 1]) + np.sin(np.radians(30)) * np.array(options.up)  # level part of the line of sight
    east = np.cross(options.north, options.up)
    assert_allclose(np.degrees(np.arctan2(ahead @ east, ahead @ options.north)) % 360, 215.0, atol=1e-6)
    assert (options.up_sigma_deg, options.north_sigma_deg) == (0.0, 10.0)


def test_maps_and_planes_found_use_them_too(tmp_path: Path, scene: Pair) -> None:
    images = write(tmp_path, scene)
    found = answer(tmp_path, images, "--metadata", command="segment")
    slope, aspect, _ = truth(LEFT)
    nearest = min(found["planes"], key=lambda plane: abs(plane["slope_deg"] - slope))
    assert abs(nearest["slope_deg"] - slope) < 2 * nearest["slope_sigma_deg"]
    assert_allclose(nearest["aspect_deg"], aspect, atol=3)
    ground = answer(tmp_path, images, "--metadata", "--sites", "0", "--spacing", "40", command="map")
    assert (ground["up"]["source"], ground["scale"]["unit"]) == ("exif", "m")


def test_focal_length_of_the_equivalent_has_its_sigma(tmp_path: Path, scene: Pair) -> None:
    film = CAMERA.fx / np.hypot(320, 240) * np.hypot(36, 24)
    images = write(tmp_path, scene, exif={FOCAL_35: round(film)}, DewarpData=None)
    assert 2.5 < answer(tmp_path, images, "--metadata")["options"]["focal_sigma_percent"] < 4
    assert applied(tmp_path, images, MetadataChoice(), Options(focal_sigma_percent=1.0)).focal_sigma_percent == 1


# ---- images that were turned ----


@pytest.mark.parametrize(("turns", "who"), [((2, 2), "both images seem"), ((2, 0), "image 1"), ((0, 2), "image 2")])
def test_a_turned_copy_is_noticed(tmp_path: Path, scene: Pair, turns: tuple[int, int], who: str) -> None:
    images = write(tmp_path, scene, turns)
    done = slopemap("estimate", *images, "--metadata", "--json", cwd=tmp_path)
    result = json.loads(done.stdout)
    said = codes(result)["metadata-contradicted"]
    assert who in said
    assert "180°" in said
    assert not any(plane["verdict"] == "safe" for plane in result["planes"])
    if all(turns):  # the angles named put it right
        angles = said.split("turned: ")[1].split()
        again = slopemap("estimate", *images, "--metadata", "--json", *angles, cwd=tmp_path)
        up = json.loads(again.stdout)["up"]["vector_cam1"]
        assert_allclose(up, -NED_1[2] * [-1, -1, 1], atol=1e-3)
        assert "metadata-contradicted" not in codes(json.loads(again.stdout))


def test_a_quarter_turn_is_noticed(tmp_path: Path, scene: Pair) -> None:
    """np.rot90 turns anticlockwise, so the pixels are to be turned 90 degrees clockwise to be as they were."""
    images = write(tmp_path, scene, (1, 1), DewarpData=None)
    done = slopemap("estimate", *images, "--metadata", "--fov", "46.83", "--json", cwd=tmp_path)
    assert "turned by 90°" in codes(json.loads(done.stdout))["metadata-contradicted"]


def test_another_flight_is_noticed(tmp_path: Path, scene: Pair) -> None:
    """The yaw is wrong by what no quarter turn explains."""
    images = write(tmp_path, scene, GimbalYawDegree=f"{YAW + 50:+.2f}")
    assert "no turn" in codes(answer(tmp_path, images, "--metadata"))["metadata-contradicted"]


def test_positions_tell_two_motions_apart(tmp_path: Path) -> None:
    """One plane, seen twice: the note names the true motion, and the option that rules out the other."""
    plane = render(R, T, [Surface(LEFT)], noise=1.0)
    images = write(tmp_path, plane)
    result = answer(tmp_path, images, "--metadata")
    assert result["ambiguity"]["status"] == "unresolved"
    (remedy,) = [one["remedy"] for one in result["diagnostics"] if one["code"] == "metadata" and one["remedy"]]
    again = answer(tmp_path, images, "--metadata", *remedy.split()[:2])
    assert again["ambiguity"]["status"] == "resolved"
    moved = np.array(again["motion"]["baseline_cam1"])
    assert moved @ T / np.linalg.norm(moved) > np.cos(np.radians(2))


# ---- what is not stated, or not usably ----


def test_height_above_take_off_is_no_scale_without_a_sigma(tmp_path: Path, scene: Pair) -> None:
    images = write(tmp_path, scene)
    said = refused(tmp_path, "--camera", "exif", "--altitude", "exif")
    assert "take-off" in said
    assert "--scale-sigma" in said
    words = ("--camera", "exif", "--up", "exif", "--altitude", "exif", "--scale-sigma", "20")
    scale = answer(tmp_path, images, *words)["scale"]
    assert scale == {"unit": "m", "source": "exif", "sigma": 0.2}
    both = MetadataChoice(may=("baseline", "altitude"))
    options = applied(tmp_path, images, both, Options(scale_sigma_percent=20))
    assert options.altitude_m is None
    assert options.baseline_m == pytest.approx(BASELINE_M, rel=0.01)


def test_positions_closer_than_their_errors_are_no_baseline(tmp_path: Path, scene: Pair) -> None:
    images = write(tmp_path, scene, GpsLatitude="47.3", RelativeAltitude="+30", GpsLongitude="8.5")
    assert "0 m apart" in refused(tmp_path, "--camera", "exif", "--baseline", "exif")
    result = answer(tmp_path, images, "--metadata")
    assert result["scale"]["unit"] == "baseline"
    assert "0 m apart" in codes(result)["metadata"]


def test_numbers_that_are_no_heights_and_places_of_two_flights(tmp_path: Path, scene: Pair) -> None:
    huge = {"RelativeAltitude": "1e308", "AbsoluteAltitude": "-1e308", "RtkStdLat": "1e300", "RtkStdLon": "1e300"}
    images = write(tmp_path, scene, **huge)
    one, two = (read_metadata(tmp_path / name) for name in images)
    assert one.position is not None
    assert (one.relative_altitude_m, one.position.altitude_m, one.position.sigma_m) == (None, None, 3.0)
    far = replace(two, position=replace(one.position, latitude_deg=-40.0))
    with pytest.raises(InputError, match="which is not one flight"):
        apply_metadata((one, far), MetadataChoice(must=("baseline",)), Options())


@pytest.mark.parametrize("zero", ["+0.00", "-0.00", "0"])
def test_a_gimbal_that_states_zero_is_unknown(tmp_path: Path, scene: Pair, zero: str) -> None:
    none = {f"Gimbal{name}Degree": zero for name in ("Yaw", "Pitch", "Roll")}
    images = write(tmp_path, scene, **none)
    assert "all 0" in refused(tmp_path, "--camera", "exif", "--up", "exif")
    result = answer(tmp_path, images, "--metadata")
    assert result["up"]["source"] == "camera"
    assert "all 0" in codes(result)["metadata"]
    assert result["place"]["north_cam1"] is None


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--camera", "exif"], "states no focal length"),
        (["--fov", "60", "--up", "exif"], "states no angles"),
        (["--fov", "60", "--north", "exif"], "states no angles"),
        (["--fov", "60", "--baseline", "exif"], "states no GPS position"),
        (["--fov", "60", "--altitude", "exif", "--scale-sigma", "9"], "no height above take-off"),
    ],
)
def test_what_an_image_does_not_state_is_one_line(tmp_path: Path, scene: Pair, arguments: list[str], said: str) -> None:
    for number, grey in ((1, scene.grey1), (2, scene.grey2)):
        (tmp_path / f"image{number}.jpg").write_bytes(photograph(grey))
    assert said in refused(tmp_path, *arguments)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--pitch", "-60", "--up", "camera"], "--pitch and --up contradict"),
        (["--pitch", "-60", "--yaw", "3", "--north", "1,0,0"], "--yaw and --north contradict"),
        (["--roll", "3"], "--roll needs --pitch"),
        (["--baseline", "exif", "--altitude", "3"], "contradict each other"),
        (["--up", "EXIF"], "is not"),
    ],
)
def test_contradictions_on_the_command_line(tmp_path: Path, scene: Pair, arguments: list[str], said: str) -> None:
    write(tmp_path, scene)
    assert said in refused(tmp_path, "--fov", "60", *arguments, status=2)


# ---- batches ----


@pytest.mark.usefixtures("_worker_here")
def test_every_pair_of_a_batch_has_its_own(tmp_path: Path, scene: Pair) -> None:
    (tmp_path / "a").mkdir()
    for name, yaw in (("one", YAW), ("two", YAW - 90)):
        place = tmp_path / "a" / name
        place.mkdir()
        write(place, scene, GimbalYawDegree=f"{yaw:+.2f}")
    command = ("batch", "a", "--pairing", "folders", "--metadata", "-o", "out", *HALVES, *QUIET)
    done = slopemap(*command, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    one, two = (json.loads((tmp_path / "out" / name / "slopes.json").read_text()) for name in ("one", "two"))
    check_planes(one)
    turned = [plane["aspect_deg"] - 90 for plane in one["planes"]]
    assert_allclose([plane["aspect_deg"] for plane in two["planes"]], np.mod(turned, 360), atol=1)
    assert "2 pairs: 2 answered" in slopemap(*command, cwd=tmp_path).stderr


# ---- from Python ----


def test_the_page_runs(tmp_path: Path, scene: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its first command, and its Python, on files of these names."""
    page = (Path(__file__).parent.parent / "docs" / "drone.md").read_text(encoding="utf-8")
    command, code = re.search(r"^slopemap (estimate .*?) +#", page, re.M), re.search(r"```python\n(.*?)```", page, re.S)
    assert command
    assert code
    for image, name in zip(write(tmp_path, scene), ("DJI_0031.JPG", "DJI_0032.JPG"), strict=True):
        (tmp_path / "flight").mkdir(exist_ok=True)
        (tmp_path / image).rename(tmp_path / "flight" / name)
    monkeypatch.chdir(tmp_path)
    assert slopemap(*command[1].split()).returncode == 0
    values: dict[str, Any] = {}
    exec(code[1], values)
    written = json.loads((tmp_path / "slopes" / "slopes.json").read_text())
    assert [plane.slope_deg for plane in values["report"].planes] == pytest.approx(
        [plane["slope_deg"] for plane in written["planes"]]
    )


def test_options_from_python(tmp_path: Path, scene: Pair) -> None:
    options = applied(tmp_path, write(tmp_path, scene), MetadataChoice(must=("up", "north", "baseline")), Options())
    assert_allclose(options.up, -NED_1[2], atol=1e-4)
    assert options.baseline_m == pytest.approx(BASELINE_M, rel=0.01)
    assert options.focal_sigma_percent == 0.5
    assert options.stated is not None
    assert_allclose(
        np.array(options.stated.attitude1).reshape(3, 3).T @ options.stated.move_m, T * BASELINE_M, atol=0.1
    )


# ---- on the earth ----


def place_of(u: float, v: float, scaled_normal: np.ndarray) -> tuple[float, float]:
    """Longitude and latitude of the ground that a pixel of image 1 shows."""
    ray = np.array([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, 1.0])
    north, east, _ = NED_1 @ (ray / (ray @ scaled_normal)) * BASELINE_M
    longitude, latitude, _ = Geod(ellps="WGS84").fwd(
        PLACE[1], PLACE[0], math.degrees(math.atan2(east, north)), math.hypot(east, north)
    )
    return longitude, latitude


def test_a_marked_corner_lies_where_it_is_on_the_earth(scene: Pair, tmp_path: Path) -> None:
    """Corners of windows and the slopes left and right of the ridge, in slopes.geojson and in the GeoTIFF."""
    images = write(tmp_path, scene)
    done = slopemap("estimate", *images, *HALVES, "--metadata", "-o", "out", *QUIET, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    features = json.loads((tmp_path / "out/slopes.geojson").read_text())["features"]
    for feature, normal, (u, v) in zip(features, (LEFT, RIGHT), ((59.5, 49.5), (179.5, 49.5)), strict=True):
        sigma = feature["properties"]["position_sigma_m"]
        assert 3.0 <= sigma < 12.0
        corners = feature["geometry"]["coordinates"][0]
        off = min(Geod(ellps="WGS84").inv(*place_of(u, v, normal), *corner)[2] for corner in corners)
        assert off < sigma
    done = slopemap("map", *images, "--metadata", "-o", "map", "--no-pictures", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    with tifffile.TiffFile(tmp_path / "map/slope_map_geo.tif") as file:
        (slope, sigma, *_), tags_of = file.pages[0].asarray(), file.pages[0].tags
        pixel, tie = tags_of["ModelPixelScaleTag"].value[0], tags_of["ModelTiepointTag"].value
        assert tags_of["GeoKeyDirectoryTag"].value[-5] == 32632
    for u, v, normal in ((80, 120, LEFT), (110, 70, LEFT), (230, 120, RIGHT), (260, 170, RIGHT)):
        easting, northing = Proj("EPSG:32632")(*place_of(u, v, normal))
        row, column = int((tie[4] - northing) / pixel), int((easting - tie[3]) / pixel)
        assert abs(slope[row, column] - truth(normal)[0]) < 3 * sigma[row, column] < 12


def test_a_position_of_ones_own_goes_before_that_of_the_image(scene: Pair, tmp_path: Path) -> None:
    images = write(tmp_path, scene)
    result = answer(tmp_path, images, "--metadata", "--position", "10,20,30", "--position-sigma", "0.5")
    assert result["place"]["position"] == {
        "latitude_deg": 10, "longitude_deg": 20, "altitude_m": 30, "sigma_m": 0.5, "sigma_up_m": 1, "apart_sigma_m": 0.5
    }  # fmt: skip


def test_what_is_missing_for_a_gis_is_said(scene: Pair, tmp_path: Path) -> None:
    images = write(tmp_path, scene)
    camera = ("--intrinsics", f"{CAMERA.fx},{CAMERA.fy},{CAMERA.cx},{CAMERA.cy}", *QUIET, *HALVES)
    for options, missing in (
        (("--position", "10,20"), "the direction of north (--yaw, --north) and metres (--baseline, --altitude)"),
        (("--position", "10,20", "--north", "0,-1,0"), "metres (--baseline, --altitude)"),
        (("--position", "10,20", "--baseline", "12.5"), "the direction of north (--yaw, --north)"),
    ):
        done = slopemap("estimate", *images, *camera, *options, "-o", "out", cwd=tmp_path)
        assert done.returncode == 0
        assert f"info: no slopes.geojson and no map of a GIS: {missing} not known" in done.stderr
        assert not (tmp_path / "out/slopes.geojson").exists()
    for text in ("91,0", "0,181", "1", "1,2,3,4", "nan,0", "x,y", "1,2,1e9"):
        done = slopemap("estimate", *images, *camera, "--position", text, "-o", "out", cwd=tmp_path)
        assert done.returncode == 2
        assert "is not LAT,LON or LAT,LON,ALT" in done.stderr
    for options, said in (
        (("--position-sigma", "1"), "--position-sigma is of a --position"),
        (("--north-sigma", "1"), "--north-sigma is of --north, --yaw or --metadata"),
    ):
        done = slopemap("estimate", *images, *camera, *options, "-o", "out", cwd=tmp_path)
        assert done.returncode == 2
        assert said in done.stderr


# ---- what is given is doubted where the image states otherwise ----


@pytest.mark.parametrize(
    ("given", "off"),
    [
        (("--pitch", "70", "--roll", "5"), True),  # the wrong sign
        (("--pitch", "-70", "--roll", "5"), False),
        (("--up", "0,0,-1", "--up-sigma", "1"), True),  # the camera looks 20 degrees off straight down
        (("--up", "0,0,-1", "--up-sigma", "10"), False),
        (("--metadata",), False),
    ],
)
def test_an_up_that_the_image_contradicts_is_used_with_a_warning(
    tmp_path: Path, scene: Pair, given: tuple[str, ...], off: bool
) -> None:
    result = answer(tmp_path, write(tmp_path, scene), *INTRINSICS, *given)
    told = codes(result).get("metadata-contradicted", "")
    assert ("given as up" in told) == off
    if off:
        assert "--pitch" in told
        assert "safe" not in {plane["verdict"] for plane in result["planes"]}
        assert result["up"]["source"] == "given"


def test_a_position_in_another_country_is_used_with_a_warning(tmp_path: Path, scene: Pair) -> None:
    images = write(tmp_path, scene)
    swapped = answer(tmp_path, images, "--metadata", "--position", f"{PLACE[1]},{PLACE[0]}")
    assert "km from the one that image 1 states" in codes(swapped)["position-contradicted"]
    assert swapped["place"]["position"]["latitude_deg"] == PLACE[1]
    near = answer(tmp_path, images, "--metadata", "--position", f"{PLACE[0] + 0.002},{PLACE[1]}")
    assert "position-contradicted" not in codes(near)
    # metadata that nobody asked for give nothing but this comparison
    alone = answer(tmp_path, images, *INTRINSICS, "--up", "0,0,-1", "--up-sigma", "10")
    assert alone["place"] is None
