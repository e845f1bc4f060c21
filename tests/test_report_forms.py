"""What a report gives to other programs: its text, a table of pandas, and the covariance of every normal."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from report_factory import make_ambiguity, make_report
from solution_factory import make_report_of, make_solution

import slopecli as sm
from slopecli.geometry import measure_slopes, normal_covariances, surface_normals
from slopecli.products import report_to_json


def test_the_text_is_that_of_the_file() -> None:
    report = make_report()
    assert report.to_json() == report_to_json(report)
    assert json.loads(report.to_json())["schema_version"] == "2.1"


def test_a_table_has_a_row_a_plane() -> None:
    pytest.importorskip("pandas")
    report = make_report()
    unknown = replace(report.planes[1], slope_sigma_deg=None, slope_ci95_deg=None, p_safe=None, verdict=None)
    report = replace(report, planes=(report.planes[0], unknown, *report.planes[2:]))
    frame = replace(report, ambiguity=make_ambiguity(report)).to_dataframe()
    assert frame.index.name == "id"
    assert list(frame.index) == [plane.id for plane in report.planes]
    assert list(frame["slope_deg"]) == [plane.slope_deg for plane in report.planes]
    assert (frame.slope_ci95_low_deg.iloc[0], frame.slope_ci95_high_deg.iloc[0]) == report.planes[0].slope_ci95_deg
    assert np.isnan(frame.slope_sigma_deg.iloc[1])
    assert frame.slope_sigma_deg.dtype == frame.p_safe.dtype == float
    assert frame.attrs["unit"] == "baseline"
    assert len(make_report(planes=()).to_dataframe()) == 0


def test_without_pandas_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(sm.InputError, match="needs pandas, which is not installed: pip install pandas"):
        make_report().to_dataframe()


def test_the_covariance_of_a_normal_is_that_of_its_tilts_whatever_up_is() -> None:
    solution = make_solution([30.0, 10.0, 45.0], sigma_deg=[0.2, 0.5, 0.1])
    covariance, normals = normal_covariances(solution), surface_normals(solution)
    for n, C, sigma in zip(normals, covariance, np.radians([0.2, 0.5, 0.1]), strict=True):
        np.testing.assert_allclose(C @ n, 0.0, atol=1e-12)
        np.testing.assert_allclose(C, sigma**2 * (np.eye(3) - np.outer(n, n)), rtol=1e-3, atol=1e-3 * sigma**2)
    for up in ([0.0, 0.0, -1.0], [0.3, -0.5, -0.8]):
        tilts = measure_slopes(solution, np.array(up)).tilt_covariance
        np.testing.assert_allclose(np.trace(covariance, axis1=1, axis2=2), np.trace(tilts, axis1=1, axis2=2))


def test_a_report_has_it_in_square_degrees_and_up_has_no_part_in_it() -> None:
    solution = make_solution([30.0, 10.0, 45.0], sigma_deg=0.2)
    exact = make_report_of(solution, sm.Options()).planes
    vague = make_report_of(solution, sm.Options(up_sigma_deg=3.0, up=(0.1, 0.0, -1.0))).planes
    for plane, other in zip(exact, vague, strict=True):
        C = plane.normal_covariance_cam1
        np.testing.assert_array_equal(C, other.normal_covariance_cam1)
        np.testing.assert_allclose(np.linalg.eigvalsh(C), [0.0, 0.04, 0.04], rtol=1e-3, atol=1e-9)
    assert exact[0].slope_sigma_deg == pytest.approx(0.2, rel=1e-2)
    written = json.loads(make_report_of(solution, sm.Options()).to_json())["planes"][0]["normal_covariance_cam1"]
    np.testing.assert_allclose(written, exact[0].normal_covariance_cam1, rtol=1e-8, atol=1e-12)


def test_a_covariance_that_is_not_known_is_null() -> None:
    assert json.loads(make_report().to_json())["planes"][0]["normal_covariance_cam1"] is None
