"""Shadows and things that moved between the images are found, measured, and the windows they touch are named."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from scenery import MEAN_GREY, SIGMA_GREY, Grey, Pair, make_camera, render, texture_at, tilted, turn, unit

from slopecli.options import Options
from slopecli.pipeline import estimate
from slopecli.types import Diagnostic, FloatArray, Image

CAMERA = make_camera(480, 360)
CODE = "dense-shadow-or-motion"
BOX = (190.0, 140.0, 70.0, 60.0)  # in window 5 of a grid of 3 x 3, which spans 160-319, 120-239
BOX_SHARE = 70 * 60 / (480 * 360)


@cache
def ground() -> Pair:
    """Sloping ground seen on a sideways move: epipolar lines run along the rows."""
    return render(turn(0.5, -1.0, 1.0), unit(1.0, 0.05, 0.1), [tilted(0.1, 0.15)], camera1=CAMERA, noise=1.5)


def corners(box: tuple[float, float, float, float], shift: tuple[float, float] = (0.0, 0.0)) -> FloatArray:
    x, y, w, h = box
    return np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]]) + shift


def shaded(grey: Grey, polygon: FloatArray, factor: float = 0.55) -> Grey:
    """With a shadow in it, its border a few px soft."""
    mask = np.zeros(grey.shape, np.float32)
    cv2.fillPoly(mask, [np.round(polygon).astype(np.int32)], 1.0)
    mask = np.asarray(cv2.GaussianBlur(mask, (0, 0), 1.5))
    return np.asarray(np.clip(grey * (1 - (1 - factor) * mask), 0, 255), np.uint8)


def found(grey1: Grey, grey2: Grey, **options: object) -> list[Diagnostic]:
    images = Image(grey1), Image(grey2)
    report = estimate(*images, CAMERA, CAMERA, replace(Options(), **options))  # type: ignore[arg-type]
    return [diagnostic for diagnostic in report.diagnostics if diagnostic.code == CODE]


def test_a_shadow_that_moved_is_told_with_its_size_and_the_windows_it_touches() -> None:
    pair = ground()
    grey1 = shaded(pair.grey1, corners(BOX))
    grey2 = shaded(pair.grey2, pair.transfer(corners(BOX, (-120.0, 0.0))))  # on the ground of window 4
    (warning,) = found(grey1, grey2)
    assert warning.severity == "warning"
    assert "darker" in warning.message
    assert "window 4 (" in warning.message
    assert "window 5 (" in warning.message
    assert warning.message.count("window") == 2
    # soft borders are not counted
    assert 1.2 * BOX_SHARE < float(warning.value or 0.0) < 2.1 * BOX_SHARE
    assert "quick succession" in str(warning.remedy)


def test_a_shadow_that_came_from_outside_is_found_as_well() -> None:
    pair = ground()
    (warning,) = found(shaded(pair.grey1, corners(BOX)), pair.grey2)
    assert "window 5 (" in warning.message
    assert "window 4" not in warning.message


def test_planes_of_any_shape_are_named() -> None:
    pair = ground()
    (warning,) = found(shaded(pair.grey1, corners(BOX)), pair.grey2, planes="ransac")
    assert "plane 1 (" in warning.message


def test_a_shadow_that_no_plane_holds_is_told_as_well() -> None:
    """Regions leave it out: one plane there explains the pixels no better than none."""
    pair = ground()
    (warning,) = found(shaded(pair.grey1, corners(BOX)), pair.grey2, planes="regions")
    assert warning.message.endswith("in no region")


def test_a_shadow_that_stays_says_nothing() -> None:
    pair = ground()
    assert found(shaded(pair.grey1, corners(BOX)), shaded(pair.grey2, pair.transfer(corners(BOX)))) == []


def test_exposure_and_falloff_of_the_lens_say_nothing() -> None:
    pair = ground()
    v, u = np.indices(pair.grey1.shape)
    falloff = 1 - 0.35 * ((u - CAMERA.cx) ** 2 + (v - CAMERA.cy) ** 2) / 300.0**2
    first = np.clip(pair.grey1 * falloff, 0, 255).astype(np.uint8)
    second = np.clip(0.7 * pair.grey2 * falloff + 20, 0, 255).astype(np.uint8)
    assert found(first, second) == []


def test_what_is_small_is_left_to_the_robust_solution() -> None:
    pair = ground()
    assert found(shaded(pair.grey1, corners((230, 170, 25, 25))), pair.grey2) == []


def with_thing(grey: Grey, corner: FloatArray, side: int) -> Grey:
    """A textured square laid into an image, its upper left corner there."""
    y, x = np.mgrid[:side, :side].astype(float)
    thing = MEAN_GREY + SIGMA_GREY * texture_at(np.stack([x, y], -1), seed=3)
    column, row = np.round(corner).astype(int)
    out = grey.copy()
    out[row : row + side, column : column + side] = np.clip(thing, 0, 255)
    return out


@pytest.mark.parametrize("side", [pytest.param(70, marks=pytest.mark.slow), 100])
def test_a_thing_that_moved_across_the_epipolar_lines_is_found(side: int) -> None:
    pair, corner = ground(), np.array([200.0, 130.0])
    grey1 = with_thing(pair.grey1, corner, side)
    grey2 = with_thing(pair.grey2, pair.transfer(corner[None])[0] + [0.0, 8.0], side)
    (warning,) = found(grey1, grey2)
    assert "moves differently" in warning.message
    assert "window 5 (" in warning.message
    assert 0.4 * side**2 < float(warning.value or 0.0) * CAMERA.width * CAMERA.height < 1.3 * side**2


def test_a_thing_that_stands_says_nothing() -> None:
    pair, corner = ground(), np.array([200.0, 130.0])
    second = with_thing(pair.grey2, pair.transfer(corner[None])[0], 100)
    assert found(with_thing(pair.grey1, corner, 100), second) == []
