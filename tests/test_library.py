"""`import slopecli as sm; sm.estimate(...)`: paths, arrays, images and keywords, and what a wrong argument is told."""

from __future__ import annotations

import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from report_factory import make_report

import slopecli as sm
from slopecli import pipeline
from slopecli.sequence import Sequence

FOLDER = Path(__file__).resolve().parent.parent / "sample_data" / "descent"
FIRST, SECOND = FOLDER / "image1.png", FOLDER / "image2.png"
CAMERA = FOLDER / "camera.json"
NATIVE = json.loads(CAMERA.read_text(encoding="utf-8"))
WINDOWS = ((0, 0, 400, 400), (400, 400, 400, 400))
SMALL = (700.0, 700.0, 60.0, 50.0)  # for arrays of 120x100 px
FOUR = tuple(NATIVE[name] for name in ("fx", "fy", "cx", "cy"))


@pytest.fixture
def reached(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The arguments that reach the pipeline, which is not run."""
    calls: list[Any] = []

    def take(*arguments: Any, **more: Any) -> sm.Report:
        calls.append(arguments)
        return make_report()

    monkeypatch.setattr(pipeline, "estimate", take)
    return calls


def grey_and_camera(reached: list[Any]) -> tuple[np.ndarray, sm.Camera]:
    return reached[-1][0].grey, reached[-1][2]


# ---- a whole estimate ----


def test_a_path_an_array_and_a_dict_give_the_slopes_of_the_sample(caplog: pytest.LogCaptureFixture) -> None:
    pixels = cv2.imread(str(SECOND), cv2.IMREAD_UNCHANGED)
    with caplog.at_level(logging.DEBUG, "slopecli"):
        report = sm.estimate(str(FIRST), pixels, camera=NATIVE)
    truth = json.loads((FOLDER / "truth.json").read_text(encoding="utf-8"))
    wanted = [one["slope_deg"] for one in truth["windows"]]
    assert [one.slope_deg for one in report.planes] == pytest.approx(wanted, abs=0.5)
    assert [bool(one.path) for one in report.images] == [True, False]
    stages = {record.message.partition(":")[0] for record in caplog.records if record.levelno == logging.DEBUG}
    assert {"solve", "report"} <= stages
    assert {record.name for record in caplog.records} == {"slopecli"}


def test_nothing_is_logged_unless_asked(reached: list[Any], capsys: pytest.CaptureFixture[str]) -> None:
    sm.estimate(FIRST, SECOND, camera=CAMERA)
    assert capsys.readouterr() == ("", "")


# ---- images ----


def test_an_array_is_taken_as_its_file_is(reached: list[Any], tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    grey = cv2.imread(str(FIRST), cv2.IMREAD_GRAYSCALE)[:100, :120]
    colour = np.dstack([grey, 255 - grey, grey // 2])
    deep = grey.astype(np.uint16) * 16 + rng.integers(0, 16, grey.shape).astype(np.uint16)
    coloured = np.dstack([deep, deep // 2, deep // 3])
    for k, pixels in enumerate([grey, colour, deep, coloured, np.dstack([colour, grey])]):
        path = tmp_path / f"{k}.png"
        cv2.imwrite(str(path), pixels)
        sm.estimate(path, pixels, camera=SMALL)
        of_file, of_array = reached[-1][:2]
        assert of_file.grey.dtype == of_array.grey.dtype == np.uint8
        np.testing.assert_array_equal(of_file.grey, of_array.grey)
        assert (of_file.colour is None) == (of_array.colour is None)
        if of_file.colour is not None:
            np.testing.assert_array_equal(of_file.colour, of_array.colour)
        assert of_file.note == of_array.note


def test_the_same_values_in_another_layout_are_the_same_image(reached: list[Any]) -> None:
    deep = cv2.imread(str(FIRST), cv2.IMREAD_GRAYSCALE)[:100, :120].astype(np.uint16) * 100
    sm.estimate(deep, deep, camera=SMALL)
    wanted = reached[-1][0].grey
    for same in (deep[:, :, None], deep.astype(">u2"), np.asfortranarray(deep), deep[::-1][::-1]):
        sm.estimate(same, deep, camera=SMALL)
        np.testing.assert_array_equal(reached[-1][0].grey, wanted)


def test_an_array_changed_later_leaves_the_image_as_it_was(reached: list[Any]) -> None:
    pixels = cv2.imread(str(FIRST), cv2.IMREAD_GRAYSCALE)
    sm.estimate(pixels, SECOND, camera=CAMERA)
    before = reached[-1][0].grey.copy()
    pixels[:] = 0
    np.testing.assert_array_equal(reached[-1][0].grey, before)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (None, "image1: is of type NoneType, needed a path, a NumPy array"),
        (b"first.png", "image1: is of type bytes"),
        ([[0, 1], [2, 3]], "image1: is of type list"),
        (np.zeros(100), "image1: is an array of shape 100 and type float64, needed rows x columns"),
        (np.zeros((2, 100, 100, 3)), "image1: is an array of shape 2x100x100x3"),
        (np.zeros((100, 100), bool), "type bool, needed"),
        (np.zeros((100, 100), complex), "type complex128, needed"),
        (np.zeros((100, 100, 2), np.uint8), "image1: has 2 channels, needed 1"),
        (np.zeros((0, 0), np.uint8), "image1: is 0x0 px"),
        (np.full((100, 100), np.nan), "image1: has no finite pixel value"),
        (sm.Image(np.zeros((100, 100), np.float32)), "image1: the grey of this Image is float32"),
        ("missing.png", "missing.png: "),
    ],
    ids=lambda value: type(value).__name__,
)
def test_a_wrong_image_is_told_what_is_wanted(value: Any, said: str, reached: list[Any]) -> None:
    with pytest.raises(sm.InputError) as caught:
        sm.estimate(value, SECOND, camera=CAMERA)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not reached


# ---- cameras ----


def test_every_form_of_a_camera_is_the_same_camera(reached: list[Any]) -> None:
    wanted = sm.load_camera(CAMERA)
    plain = replace(wanted, model="pinhole", distortion=())
    K = plain.K
    for given in (str(CAMERA), CAMERA, wanted, NATIVE, sm.CameraChoice(file=str(CAMERA))):
        sm.estimate(FIRST, SECOND, camera=given)
        assert [replace(one, source="") for one in reached[-1][2:4]] == [replace(wanted, source="")] * 2
    matrix = {"K": K, "width": np.int64(plain.width), "height": plain.height}
    for given in (FOUR, list(FOUR), np.array(FOUR), K, K.tolist(), matrix):
        sm.estimate(FIRST, SECOND, camera=given)
        assert replace(reached[-1][2], source="") == replace(plain, source="")


def test_each_image_may_have_a_camera_of_its_own(reached: list[Any]) -> None:
    longer = (1.1 * FOUR[0], 1.1 * FOUR[1], *FOUR[2:])
    sm.estimate(FIRST, SECOND, FOUR, longer)
    assert [one.fx for one in reached[-1][2:4]] == [FOUR[0], longer[0]]
    sm.estimate(FIRST, SECOND, camera=FOUR, camera2=longer)
    assert [one.fx for one in reached[-1][2:4]] == [FOUR[0], longer[0]]
    sm.estimate(FIRST, SECOND, FOUR)
    assert [one.fx for one in reached[-1][2:4]] == [FOUR[0], FOUR[0]]


def test_a_camera_is_scaled_to_an_image_resized(reached: list[Any], caplog: pytest.LogCaptureFixture) -> None:
    small = cv2.resize(cv2.imread(str(FIRST)), None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    for given in (CAMERA, NATIVE, sm.load_camera(CAMERA)):
        with caplog.at_level(logging.INFO, "slopecli"):
            sm.estimate(small, SECOND, camera=given)
        assert reached[-1][2].fx == pytest.approx(NATIVE["fx"] / 2)
        assert "intrinsics scaled by 0.5" in caplog.text
        caplog.clear()
    with pytest.raises(sm.InputError, match="not the same view resized"):
        sm.estimate(small[:, :-30], SECOND, camera=NATIVE)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "camera: is missing, needed a path, a Camera, a dict"),
        ({"camera": 800.0}, "camera: is of type float, needed a path, a Camera"),
        ({"camera": (800.0, 800.0)}, "camera: has 2 values, needed"),
        ({"camera": ("a", "b", "c", "d")}, "camera: fx is 'a', needed a number"),
        ({"camera": (-800.0, 800.0, 1.0, 1.0)}, "camera: "),
        ({"camera": {"fy": 1.0}}, "camera: fx is missing"),
        ({"camera": {**NATIVE, "focal": 1.0}}, "camera: unknown key 'focal'"),
        ({"camera": FOUR, "camera1": FOUR}, "camera and camera1 are both given"),
        ({"camera": FOUR, "camera2": object()}, "camera2: is of type object"),
        ({"camera": "missing.yaml"}, "missing.yaml: "),
    ],
)
def test_a_wrong_camera_is_told_what_is_wanted(given: dict[str, Any], said: str, reached: list[Any]) -> None:
    with pytest.raises(sm.InputError) as caught:
        sm.estimate(FIRST, SECOND, **given)
    assert str(caught.value).startswith(said)
    assert "\n" not in str(caught.value)
    assert not reached


# ---- keywords ----


def test_keywords_are_fields_of_options(reached: list[Any]) -> None:
    up = np.array([0.0, 0.1, -1.0])
    sm.estimate(FIRST, SECOND, camera=CAMERA, grid=[4, np.int64(2)], up=up, up_sigma_deg=1, solver="ha")
    wanted = sm.Options(grid=(4, 2), up=(0.0, 0.1, -1.0), up_sigma_deg=1.0, solver="ha")
    assert reached[-1][4] == wanted
    sm.estimate(FIRST, SECOND, camera=CAMERA, options=wanted, seed=3, up="camera")
    assert reached[-1][4] == replace(wanted, seed=3, up="camera")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"tolerence_deg": 10.0}, "there is no argument 'tolerence_deg'; did you mean tolerance_deg?"),
        ({"zzz": 1}, "there is no argument 'zzz'; there are camera, camera1, camera2, altitude_m"),
        ({"footprint_px": 40.0}, "there is no argument 'footprint_px'"),
        ({"tolerance_deg": "10"}, "tolerance_deg: is '10', needed a number"),
        ({"tolerance_deg": float("nan")}, "tolerance_deg: is nan, needed a number"),
        ({"seed": 1.5}, "seed: is 1.5, needed a whole number"),
        ({"seed": True}, "seed: is True, needed a whole number"),
        ({"grid": "3x3"}, "grid: is '3x3', needed (a whole number, a whole number)"),
        ({"grid": (3, 3, 3)}, "grid: is (3, 3, 3), needed"),
        ({"windows": (0, 0, 9, 9)}, "windows: is (0, 0, 9, 9), needed ((a whole number"),
        ({"free_focal": 1}, "free_focal: is 1, needed True or False"),
        ({"solver": "best"}, "solver: is 'best', needed 'mle' or 'ha' or 'lh'"),
        ({"planes": "window"}, "planes: is 'window', needed one of windows, "),
        ({"up": (0.0, 1.0)}, "up: is (0.0, 1.0), needed a string or (a number, a number, a number)"),
        ({"options": {"grid": (3, 3)}}, "options: is of type dict, needed Options, or its fields by name"),
        ({"baseline_m": 1.0, "altitude_m": 9.0}, "baseline_m and altitude_m are both given"),
        ({"windows": WINDOWS, "grid": (2, 2)}, "windows and grid are both given"),
    ],
    ids=str,
)
def test_a_wrong_keyword_is_told_what_is_wanted(given: dict[str, Any], said: str, reached: list[Any]) -> None:
    with pytest.raises(sm.WrongArgument) as caught:
        sm.estimate(FIRST, SECOND, camera=CAMERA, **given)
    assert str(caught.value).startswith(said)
    assert isinstance(caught.value, TypeError)
    assert not reached


def test_a_map_takes_the_fields_of_both_kinds_of_options(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[Any] = []

    class Found:
        report = make_report()

    def take(*arguments: Any, **more: Any) -> Found:
        calls.append(arguments)
        return Found()

    monkeypatch.setattr(pipeline, "slope_map", take)
    sm.slope_map(FIRST, SECOND, camera=CAMERA, footprint_px=40, tolerance_deg=10, classes_deg=[5, 10])
    wanted = sm.MapOptions(footprint_px=40.0, classes_deg=(5.0, 10.0))
    assert calls[-1][4:] == (sm.Options(tolerance_deg=10.0), wanted)
    images, camera = (sm.load_image(FIRST), sm.load_image(SECOND)), sm.load_camera(CAMERA)
    sm.slope_map(*images, camera, camera, sm.Options(seed=2), wanted)
    assert calls[-1] == (*images, camera, camera, sm.Options(seed=2), wanted)
    with pytest.raises(sm.WrongArgument, match="did you mean spacing_px"):
        sm.slope_map(FIRST, SECOND, camera=CAMERA, spacing_p=40)
    with pytest.raises(sm.WrongArgument, match="wanted: is of type int, needed MapOptions"):
        sm.slope_map(FIRST, SECOND, CAMERA, CAMERA, sm.Options(), 40)  # type: ignore[arg-type]


@pytest.mark.parametrize("read", [sm.load_image, sm.load_camera, sm.load_pose], ids=lambda one: one.__name__)
def test_what_is_no_path_is_told_what_is_wanted(read: Any) -> None:
    for given in (5, None, np.eye(3)):
        with pytest.raises(sm.WrongArgument, match=f"file is given as {type(given).__name__}, needed its path"):
            read(given)


WRONG: Any = 3  # of no type that they take
TEXT: Any = "a.png"
NO_ANSWER_YET: dict[str, tuple[Any, str]] = {
    "measure_slopes": (lambda: sm.measure_slopes(WRONG), "solution is of type int, needed a Solution"),
    "solve": (lambda: sm.solve(WRONG, None, sm.Options()), "given is of type int, needed a Given"),
    "write_outputs": (lambda: sm.write_outputs(WRONG, WRONG, "out"), "report is of type int, needed a Report"),
    "write_map": (lambda: sm.write_map(WRONG, WRONG, "out"), "slope_map is of type int, needed a SlopeMap"),
    "report_to_json": (lambda: sm.report_to_json(WRONG), "report is of type int, needed a Report"),
    "camera_from_fov": (lambda: sm.camera_from_fov(TEXT, 8, 8), "needed a number of degrees"),
    "camera_from_intrinsics": (lambda: sm.camera_from_intrinsics(WRONG, 8, 8), "needed fx, fy, cx and cy"),
    "sequence": (lambda: Sequence(TEXT), "camera is of type str, needed a Camera"),
    "read_correspondences": (lambda: sm.read_correspondences(WRONG), "needed its path"),
}


@pytest.mark.parametrize(("call", "said"), NO_ANSWER_YET.values(), ids=NO_ANSWER_YET)
def test_what_comes_of_another_function_is_told_of_which(call: Any, said: str) -> None:
    with pytest.raises(sm.WrongArgument, match=said):
        call()


def test_texts_are_no_points() -> None:
    with pytest.raises(sm.InputError, match="no array of numbers"):
        sm.solve_planes("x1", "x2", "patch")
