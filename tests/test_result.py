"""slopes.json: the keys that are promised, no NaN, the same bytes every time."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jsonschema import Draft202012Validator, ValidationError
from report_factory import make_ambiguity, make_camera, make_report

from slopecli import __version__
from slopecli.errors import InputError
from slopecli.io import load_schema
from slopecli.products import report_to_json
from slopecli.types import Report

OLD = Path(__file__).parent / "slopes-1.0.json"
TOP_LEVEL = (
    "schema_version slopemap_version images cameras options up scale motion fit ambiguity planes rejected diagnostics "
    "place"
)
CAMERA = "width height fx fy cx cy model distortion source"
PLANE = (
    "id source polygon_px normal_cam1 distance slope_deg slope_sigma_deg slope_ci95_deg aspect_deg dip_direction_deg "
    "n_correspondences n_inliers rms_px roughness homography_px verdict p_safe status reason "
    "slope_sigma_causes_deg azimuth_sigma_deg normal_covariance_cam1"
)


def refuse_constant(name: str) -> None:
    raise AssertionError(f"{name} is no JSON")


def parsed(report: Report) -> Any:
    return json.loads(report_to_json(report), parse_constant=refuse_constant)


def ambiguous() -> Report:
    report = make_report()
    return replace(report, ambiguity=make_ambiguity(report))


def without_numbers() -> Report:
    report = make_report()
    plane = replace(
        report.planes[0], slope_sigma_deg=float("nan"), slope_ci95_deg=(np.nan, np.inf), p_safe=np.float64("nan")
    )
    return replace(report, planes=(plane,), fit=replace(report.fit, noise_px=float("nan")))


def empty() -> Report:
    return make_report(planes=(), rejected=(), diagnostics=())


def distorted() -> Report:
    return make_report(make_camera(model="brown", distortion=(-0.28, 0.07, 1.9e-4, 1.8e-5)))


@pytest.mark.parametrize("make", [make_report, ambiguous, without_numbers, empty, distorted])
def test_every_result_keeps_the_schema(make: Any) -> None:
    assert not list(Draft202012Validator(load_schema()).iter_errors(parsed(make())))


def test_schema_is_a_schema_and_refuses_changed_keys() -> None:
    schema = load_schema()
    Draft202012Validator.check_schema(schema)
    result = parsed(make_report())
    for wrong in ({**result, "extra": 1}, {key: result[key] for key in result if key != "up"}):
        with pytest.raises(ValidationError):
            Draft202012Validator(schema).validate(wrong)
    result["planes"][0]["slope"] = 3.0
    with pytest.raises(ValidationError):
        Draft202012Validator(schema).validate(result)


def test_files_of_1_0_still_validate() -> None:
    """OLD was written by slopemap 0.1.0; its schema is shipped, and is another one than today's."""
    old = json.loads(OLD.read_text(encoding="utf-8"))
    assert not list(Draft202012Validator(load_schema(old["schema_version"])).iter_errors(old))
    assert list(Draft202012Validator(load_schema()).iter_errors(old))


def test_a_version_without_a_schema_is_refused() -> None:
    with pytest.raises(InputError, match=r"version '1\.5'"):
        load_schema("1.5")


def test_keys_and_their_order() -> None:
    result = parsed(make_report())
    assert list(result) == TOP_LEVEL.split()
    assert list(result["planes"][0]) == PLANE.split()
    assert list(result["cameras"][0]) == CAMERA.split()
    assert result["schema_version"] == "2.1"
    assert result["slopemap_version"] == __version__


def test_what_is_not_a_number_is_null() -> None:
    result = parsed(without_numbers())
    plane = result["planes"][0]
    assert plane["slope_sigma_deg"] is None
    assert plane["slope_ci95_deg"] == [None, None]
    assert plane["p_safe"] is None
    assert result["fit"]["noise_px"] is None


def test_numbers_keep_nine_digits() -> None:
    report = make_report()
    shown = np.array(parsed(report)["planes"][2]["homography_px"])
    np.testing.assert_allclose(shown, report.planes[2].homography_px, rtol=5.1e-9, atol=1e-12)


def test_rounding_noise_does_not_show() -> None:
    """What another processor leaves in the last bits, and the sign of a zero, must not change the bytes."""
    report = make_report()
    motion = report.motion
    shaken = replace(motion, rotation_cam2_from_cam1=motion.rotation_cam2_from_cam1 * (1 + 1e-14) - 1e-17)
    zero = replace(report.fit, rms_px=-0.0), replace(report.fit, rms_px=3e-17)
    assert report_to_json(replace(report, motion=shaken)) == report_to_json(report)
    assert report_to_json(replace(report, fit=zero[0])) == report_to_json(replace(report, fit=zero[1]))


def test_numpy_and_paths_in_options_become_plain_json() -> None:
    options = {
        "grid": np.array([3, 3]),
        "seed": np.int64(7),
        "fast": np.bool_(True),
        "up": Path("up.json"),
        "x": (1, None),
    }
    shown = parsed(make_report(options=options))["options"]
    assert shown == {"grid": [3, 3], "seed": 7, "fast": True, "up": "up.json", "x": [1, None]}


def test_any_file_name_survives() -> None:
    """A name need be neither ASCII nor valid Unicode (undecodable bytes come as lone surrogates)."""
    report = make_report()
    for path in ("Süd/Höhe 1.png", "broken\udcff.png"):
        text = report_to_json(replace(report, images=(replace(report.images[0], path=path), report.images[1])))
        assert text.isascii()
        assert json.loads(text)["images"][0]["path"] == path


def test_a_person_can_read_it() -> None:
    """Short lists stay on one line, so that a plane takes a screen and not ten."""
    lines = report_to_json(make_report()).splitlines()
    assert max(map(len, lines)) <= 120
    assert len(lines) < 45 * 9
    assert any(line.strip().startswith('"normal_cam1": [') and line.endswith("],") for line in lines)


def test_every_key_is_explained() -> None:
    schema = load_schema()
    objects = [schema, *schema["$defs"].values(), *schema["properties"].values()]
    keys = {key for entry in objects for key in entry.get("properties", {})}
    page = (Path(__file__).parent.parent / "docs" / "output.md").read_text(encoding="utf-8")
    assert sorted(key for key in keys if f"`{key}`" not in page) == []
