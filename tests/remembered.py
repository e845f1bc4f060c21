"""The pipeline with a memory, for tests of what is done with an answer: the same images are estimated only once.

`remembered` stands for `estimate`, whatever the files are called. `solved_once` stands for the part of estimates and
maps that comes to the answer, so that reports, maps and files are made of it each time.
"""

from __future__ import annotations

from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from slopecli import pipeline
from slopecli.options import Options
from slopecli.pipeline import estimate
from slopecli.types import Camera, Image, Report

_answers: dict[str, Report] = {}
_solved: dict[str, Any] = {}  # least recently used first
_MOST = 8  # scenes have arrays of a few MB
_solve = pipeline._answer


def remembered(image1: Image, image2: Image, camera1: Camera, camera2: Camera, options: Options, **more: Any) -> Report:
    """What `estimate` answers, or has answered before for the same pixels, cameras and options from other files."""
    images, cameras = (image1, image2), (camera1, camera2)
    pixels = _pixels(images)
    # of what a camera is from only the name counts, by which a field of view is told from a file
    named = [replace(camera, source=Path(camera.source).name) for camera in cameras]
    key = repr((pixels, named, options))
    if key not in _answers:
        _answers[key] = estimate(*images, *cameras, options, **more)
    report = _answers[key]
    assert not options.free_focal  # the cameras are then others
    first, second = (
        replace(info, path=image.path, sha256=image.sha256) for info, image in zip(report.images, images, strict=True)
    )
    return replace(report, images=(first, second), cameras=cameras)


def solved_once(
    images: tuple[Image, Image], cameras: tuple[Camera, Camera], given: Any, options: Options, *more: Any
) -> Any:
    """What `pipeline._answer` answers, or has answered before for the same files, cameras and options."""
    key = repr((_pixels(images), [image.path for image in images], cameras, given, options))
    _solved[key] = _solved.pop(key, None) or _solve(images, cameras, given, options, *more)
    while len(_solved) > _MOST:
        del _solved[next(iter(_solved))]
    return _solved[key]


def forget() -> None:
    """For a test that the same comes out once more."""
    _answers.clear()
    _solved.clear()


def _pixels(images: tuple[Image, Image]) -> list[Any]:
    return [(image.note, image.grey.shape, sha256(image.grey.tobytes()).hexdigest()) for image in images]
