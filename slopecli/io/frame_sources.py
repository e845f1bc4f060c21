"""Frames of a sequence: image files, a folder of them, a video file or a camera, read one at a time."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from slopecli.errors import InputError
from slopecli.io.files import csv_rows, read_file
from slopecli.io.images import decode_image, load_image, read_image_file
from slopecli.io.pair_sources import images_in, why_no_images
from slopecli.sequence.frame import Frame, FramePrior
from slopecli.types import Image

VIDEO_SUFFIXES = {".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".mjpeg", ".ts"}


Position = tuple[float, float, float]


@dataclass(frozen=True)
class VideoChoice:
    """Which frames of a video are taken: from `start_s` to `stop_s`, every n-th, or so many a second.

    every : 1 for all.  fps : frames a second of the video's own time, None for all.
    """

    every: int
    fps: float | None = None
    start_s: float = 0.0
    stop_s: float | None = None


@dataclass(frozen=True, eq=False)
class FrameSource:
    """Frames to come: `total` where their number is known; `first` was read already, for the size of the camera."""

    first: Frame
    rest: Iterator[Frame]
    total: int | None = None

    @property
    def image(self) -> Image:
        """The first image."""
        if self.first.image is None:
            raise InputError(f"{self.first.name}: {self.first.problem}")
        return self.first.image

    def __iter__(self) -> Iterator[Frame]:
        yield self.first
        yield from self.rest


def open_frames(
    paths: Sequence[str],
    pattern: str = "",
    times: Sequence[float] | None = None,
    video: VideoChoice | None = None,
    positions: Sequence[Position] | None = None,
) -> FrameSource:
    """Frames of files, of one folder in natural order, or of one video.

    pattern : of the names of images in a folder; "" for all.
    times, positions : s, and m, one a frame, of files and folders.

    Raises
    ------
    InputError : there are no frames, no first one, or not as many times as frames.
    """
    if len(paths) == 1 and Path(paths[0]).is_dir():
        names = [str(Path(paths[0], name)) for name in images_in(paths[0], pattern)]
        if not names:
            raise InputError(f"{paths[0]}: holds no images; {why_no_images(paths[0])}")
        return _of_files(names, times, positions)
    if len(paths) == 1 and Path(paths[0]).suffix.lower() in VIDEO_SUFFIXES:
        if times is not None or positions is not None:
            raise InputError(f"{paths[0]}: is a video, which has its own times; --times and --positions are for images")
        return _of_video(paths[0], video or VideoChoice(1))
    return _of_files(paths, times, positions)


def _of_files(paths: Sequence[str], times: Sequence[float] | None, positions: Sequence[Position] | None) -> FrameSource:
    if len(paths) == 1 and not Path(paths[0]).exists():
        raise InputError(f"{paths[0]}: no such folder, video or image; check the path")
    if len(paths) < 2:
        raise InputError(f"{paths[0]}: is one image, a sequence needs at least two; give more, a folder or a video")
    for flag, values in (("--times", times), ("--positions", positions)):
        if values is not None and len(values) != len(paths):
            raise InputError(f"{flag} has {len(values)} lines for {len(paths)} frames; give one a frame")
    load_image(paths[0])  # the size of the camera is that of the first: it must be readable
    frames = read_frames(paths, times=times, positions=positions)
    return FrameSource(next(frames), frames, len(paths))


def read_frames(
    paths: Sequence[str],
    base: str = "",
    times: Sequence[float] | None = None,
    positions: Sequence[Position] | None = None,
) -> Iterator[Frame]:
    """Frames of image files, relative to `base`; what is wrong with one that cannot be read is its problem."""
    for k, path in enumerate(paths):
        time_s = None if times is None else times[k]
        prior = None if positions is None else FramePrior(positions[k])
        try:
            yield Frame(path, decode_image(read_image_file(path, base), path), time_s, prior=prior)
        except InputError as error:
            yield Frame(path, None, time_s, str(error).removeprefix(f"{path}: "), prior)


def _of_video(path: str, choice: VideoChoice) -> FrameSource:
    if not Path(path).is_file():
        raise InputError(f"{path}: no such video; check the path")
    with _decoders_silent():
        capture = cv2.VideoCapture(path)
    if not capture.isOpened():
        raise InputError(f"{path}: is no video that OpenCV can read; make an MP4 or AVI of it, or a folder of images")
    rate = capture.get(cv2.CAP_PROP_FPS) or 30.0
    frames = _video_frames(capture, Path(path).name, rate, choice)
    first = next(frames, None)
    if first is None:
        raise InputError(f"{path}: has no frame between --start and --stop; check them and the file")
    length = capture.get(cv2.CAP_PROP_FRAME_COUNT)
    step = _step(rate, choice)
    stop = min(length, rate * choice.stop_s) if choice.stop_s is not None else length
    total = math.ceil((stop - rate * choice.start_s) / step) if length > 0 else None
    return FrameSource(first, frames, total)


@contextmanager
def _decoders_silent() -> Iterator[None]:
    """What OpenCV and the decoders below it write to stderr is dropped: that a video cannot be read is said by us."""
    try:
        kept = os.dup(2)
    except OSError:  # there is no stderr
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(nowhere)
        os.close(kept)


def _grabbed(capture: cv2.VideoCapture) -> bool:
    """Whether there is a next frame."""
    with _decoders_silent():
        return bool(capture.grab())


def _step(rate: float, choice: VideoChoice) -> float:
    """Frames of the video from one taken to the next."""
    return choice.every * (max(rate / choice.fps, 1.0) if choice.fps else 1.0)


def _video_frames(capture: cv2.VideoCapture, name: str, rate: float, choice: VideoChoice) -> Iterator[Frame]:
    step, wanted, number = _step(rate, choice), rate * choice.start_s, -1
    try:
        while _grabbed(capture):
            number += 1
            if choice.stop_s is not None and number > rate * choice.stop_s:
                return
            if number < wanted - 1e-6:
                continue
            wanted += step
            with _decoders_silent():
                good, pixels = capture.retrieve()
            label = f"{name}#{number}"
            if good:
                yield Frame(label, _image_of(pixels, label), number / rate)
            else:
                yield Frame(label, None, number / rate, "cannot be decoded")
    finally:
        capture.release()


def open_camera(device: str) -> FrameSource:
    """Frames of a camera of this computer, by number or by the name of its device, until it is switched off."""
    import time

    with _decoders_silent():
        capture = cv2.VideoCapture(int(device) if device.isdigit() else device)
    if not capture.isOpened():
        raise InputError(f"no camera answers as {device}; check its number or name, and that nothing else uses it")

    def frames() -> Iterator[Frame]:
        """One frame after the other, until the camera gives no more."""
        start, number = time.monotonic(), 0
        try:
            while True:
                good, pixels = capture.read()
                if not good:
                    return
                number += 1
                label = f"live#{number}"
                yield Frame(label, _image_of(pixels, label), time.monotonic() - start)
        finally:
            capture.release()

    every = frames()
    first = next(every, None)
    if first is None:
        raise InputError(f"the camera {device} gives no picture; check it")
    return FrameSource(first, every, None)


def _image_of(pixels: object, name: str) -> Image:
    array = np.asarray(pixels, np.uint8)
    if array.ndim == 2:
        return Image(array, path=name)
    return Image(np.asarray(cv2.cvtColor(array, cv2.COLOR_BGR2GRAY), np.uint8), array, path=name)


def read_times(path: str) -> list[float]:
    """Times in s, one a line, or the last column of a CSV file; InputError for what is no rising list of numbers."""
    data = read_file(path, "file of times", 100_000_000)
    needed = "needed one time in s a line"
    times: list[float] = []
    for line, cells in csv_rows(path, data, needed):
        try:
            value = float(cells[-1])
        except ValueError:
            if not times and line == 1:  # a heading
                continue
            raise InputError(f"{path}: line {line} has {cells[-1]!r}; {needed}") from None
        if not math.isfinite(value) or (times and value <= times[-1]):
            raise InputError(f"{path}: line {line} has {value:g}, which is not later than the line before; {needed}")
        times.append(value)
    if not times:
        raise InputError(f"{path}: has no times; {needed}")
    return times


def read_positions(path: str) -> list[Position]:
    """Positions x, y, z in m, one a line, or lines of a trajectory in TUM format; InputError for anything else."""
    data = read_file(path, "file of positions", 100_000_000)
    needed = "needed x, y, z in m a line, or lines in TUM format: time, x, y, z, and a quaternion"
    found: list[Position] = []
    for line, cells in csv_rows(path, data, needed, ", "):
        if cells[0].startswith("#"):
            continue
        try:
            values = [float(cell) for cell in cells if cell]
        except ValueError:
            if not found and line == 1:  # a heading
                continue
            raise InputError(f"{path}: line {line} is {' '.join(cells)[:60]!r}; {needed}") from None
        values = values[1:4] if len(values) == 8 else values
        if len(values) != 3 or not all(map(math.isfinite, values)):
            raise InputError(f"{path}: line {line} has {len(cells)} values; {needed}")
        found.append((values[0], values[1], values[2]))
    if not found:
        raise InputError(f"{path}: has no positions; {needed}")
    return found
