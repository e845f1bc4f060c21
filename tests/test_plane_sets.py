"""Planes found on whole sets of pairs with known truth, as benchmarks/planes.py measures them. Needs SLOPEMAP_DATA."""

from __future__ import annotations

import os
import runpy
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

DATA = Path(os.environ.get("SLOPEMAP_DATA", "."))
BENCHMARK = runpy.run_path(str(Path(__file__).resolve().parent.parent / "benchmarks" / "planes.py"))

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif("SLOPEMAP_DATA" not in os.environ, reason="SLOPEMAP_DATA names no folder of image pairs"),
]


@cache
def segmented(path: Path) -> Any:
    return BENCHMARK["segmented"](path)


def measured(patterns: list[str]) -> tuple[float, np.ndarray, float]:
    """Share of the true planes that are found, the errors of their normals, deg, and the share sure and wrong."""
    found = [segmented(path) for pattern in patterns for path in sorted(DATA.glob(pattern))]
    errors = np.array([error for one in found for error in one.errors_deg])
    share = len(errors) / (len(errors) + sum(one.missing for one in found))
    return share, errors, sum(one.sure_and_wrong for one in found) / len(errors)


def test_rendered_towns() -> None:
    share, errors, wrong = measured(["rendered/C*/truth.json"])
    assert share >= 0.8
    assert np.median(errors) <= 0.4
    assert np.mean(errors < 5) >= 0.9
    assert wrong <= 0.03


@pytest.mark.parametrize(("name", "count"), [("C07_platform_nadir_glide", 2), ("C08_platform_oblique", 3)])
def test_a_platform_has_exactly_its_planes(name: str, count: int) -> None:
    found = segmented(DATA / "rendered" / name / "truth.json")
    assert found.n_planes == count
    assert found.missing == 0


def test_photographs_of_rooms_and_facades() -> None:
    sets = ("middlebury-2014-trainingQ", "strecha", "sceaux-castle", "lund-door")
    share, errors, wrong = measured([f"real/{name}/*.truth.json" for name in sets])
    assert share >= 0.62
    assert np.median(errors) <= 1.5
    assert wrong <= 0.12  # the furniture and pipes of a room are planes by courtesy


@pytest.mark.parametrize("finder", ["regions", "ransac"])
def test_homographies_without_known_intrinsics(finder: str) -> None:
    files = sorted(DATA.glob("real/middlebury-2001-planar/*.truth.json"))
    errors = np.array([error for path in files for error in BENCHMARK["transfer_errors_px"](path, finder)])
    known = errors[np.isfinite(errors)]
    assert len(known) >= 0.75 * len(errors)
    assert np.median(known) < 0.25
    assert known.max() < 0.6
