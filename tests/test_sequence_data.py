"""Sequences of known ground, rendered and photographed: no worse than their best pairs. Folder: SLOPEMAP_DATA."""

from __future__ import annotations

import json
import os
import runpy
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from slopecli.io import load_image
from slopecli.options import Options
from slopecli.pipeline import estimate, sequence_answer
from slopecli.sequence import Sequence
from slopecli.types import Camera, FloatArray, Image, Report

DATA = Path(os.environ.get("SLOPEMAP_DATA", "."))
BENCHMARK = runpy.run_path(str(Path(__file__).resolve().parent.parent / "benchmarks" / "sequence.py"))

pytestmark = [
    pytest.mark.skipif("SLOPEMAP_DATA" not in os.environ, reason="SLOPEMAP_DATA names no folder of image pairs"),
    pytest.mark.slow,
]


@cache
def descent() -> Any:
    return BENCHMARK["true_sequences"](DATA, "E01_descent")[0]


@cache
def rows() -> list[Any]:
    return BENCHMARK["followed"](descent(), pairs=False)


def errors_of_pair(number: int) -> FloatArray:
    return np.array(BENCHMARK["_pair"](descent(), number)[0])


def test_a_descent_is_as_good_as_its_best_pair() -> None:
    """`estimate` has all pixels of nine windows in the first pair, which is the best; a sequence 225 points of each."""
    pair, found = errors_of_pair(1), np.array([row.errors for row in rows()])
    assert found.shape == (11, 9)
    for share in (0.5, 0.9):
        best, errors = np.quantile(pair, share), np.quantile(found, share, axis=1)
        assert errors[0] < 1.2 * best
        assert errors[3:].max() < 1.1 * best
    assert all((row.errors <= 2.0 * row.sigmas).all() for row in rows())


def test_sigmas_of_rough_ground_fall_as_frames_come() -> None:
    """What is left at the end is of the parts of windows that no other frame shows; of the middle one all is shown."""
    sigmas = np.array([row.sigmas for row in rows()])
    middle, all_of_them = sigmas[:, 4], np.median(sigmas, axis=1)
    assert (np.diff(all_of_them) < 0.01 * all_of_them[0]).all()
    assert all_of_them[-1] < 0.95 * all_of_them[0]
    assert middle[1:].max() < 0.7 * middle[0]


def test_the_answer_at_the_end_is_as_good_as_that_of_the_best_pair() -> None:
    """It has all pixels of rough windows, as `estimate` has."""
    pair, truth = errors_of_pair(1), descent()
    runner = Sequence(truth.camera, Options(), keep_depth=True)
    for number, frame in enumerate(truth.frames, 1):
        runner.add(frame)
        if number in (5, 12):
            errors, sigmas = BENCHMARK["_judged"](sequence_answer(runner).report, truth)
            for share in (0.5, 0.9):
                assert np.quantile(errors, share) < 1.1 * np.quantile(pair, share)
            assert (errors <= 2.5 * sigmas).all()


def test_baselines_of_a_descent_keep_their_ratios() -> None:
    assert max(abs(row.ratio - 1.0) for row in rows()) < 0.002


@pytest.mark.parametrize(("suffix", "codec"), [("mp4", "mp4v"), ("avi", "MJPG")])
def test_a_video_of_a_descent_gives_what_its_frames_give(tmp_path: Path, suffix: str, codec: str) -> None:
    truth, file = descent(), str(tmp_path / f"descent.{suffix}")
    writer = cv2.VideoWriter(file, cv2.VideoWriter.fourcc(*codec), 10.0, (truth.camera.width, truth.camera.height))
    for frame in truth.frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()
    video, frames = cv2.VideoCapture(file), []
    while True:
        good, pixels = video.read()
        if not good:
            break
        frames.append(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY))
    assert len(frames) == len(truth.frames)
    straight, filmed = (reported(truth.camera, some) for some in (truth.frames, frames))
    for one, other in zip(straight.planes, filmed.planes, strict=True):
        assert one.slope_sigma_deg is not None
        assert other.slope_sigma_deg is not None
        assert abs(one.slope_deg - other.slope_deg) < 2.0 * np.hypot(one.slope_sigma_deg, other.slope_sigma_deg)


def reported(camera: Camera, frames: list[Any], options: Options | None = None) -> Report:
    sequence = Sequence(camera, options or Options())
    for frame in frames:
        sequence.add(frame)
    return sequence.report()


@pytest.mark.parametrize(
    ("pair", "names"),
    [
        ("IMG_0133__IMG_0148", "0133 0136 0142 0148"),
        ("IMG_0136__IMG_0142", "0136 0142 0148 0133"),
    ],
)
def test_a_photographed_descent_is_no_worse_than_its_pair(pair: str, names: str) -> None:
    found = sorted(DATA.rglob(f"drone-copr-descent/{pair}.truth.json"))
    if not found:
        pytest.skip("the photographs are not in the folder")
    truth = json.loads(found[0].read_text())
    K, size = np.array(truth["K1"]), truth["size1"]
    lens = (*truth["dist1"], 0.0, 0.0, 0.0)
    camera = Camera(size[0], size[1], K[0, 0], K[1, 1], K[0, 2], K[1, 2], "brown", lens)
    tiles = [plane for plane in truth["planes"] if plane["name"] != "whole"]
    low, high = (np.array([edge(plane["polygon"], axis=0) for plane in tiles], int) for edge in (np.min, np.max))
    options = Options(windows=tuple(tuple(map(int, (*a, *(b - a)))) for a, b in zip(low, high, strict=True)))
    images = [load_image(str(found[0].parent / f"IMG_{name}.jpg")) for name in names.split()]
    both = [Image(images[0].grey), Image(images[-1 if "0148" in pair else 1].grey)]
    alone = errors_of(estimate(*both, camera, camera, options), tiles)
    report = reported(camera, [image.grey for image in images], options)
    errors = errors_of(report, tiles)
    assert errors.keys() >= alone.keys()
    for plane in report.planes:
        doubt = np.hypot(plane.slope_sigma_deg or 0.0, tiles[plane.id - 1]["normal_sigma_deg"])
        assert errors[plane.id] < alone.get(plane.id, np.inf) + doubt
    assert np.median(list(errors.values())) < 0.5


def errors_of(report: Report, tiles: list[Any]) -> dict[int, float]:
    """Angle between normals found and true, deg, by id of the window."""
    cosines = {plane.id: abs(float(plane.normal_cam1 @ np.array(tiles[plane.id - 1]["n"]))) for plane in report.planes}
    return {number: float(np.degrees(np.arccos(min(cosine, 1.0)))) for number, cosine in cosines.items()}
