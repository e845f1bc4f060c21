"""The film of a sequence: every frame with the windows where their planes put them, as an MP4 file."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

import cv2
import numpy as np

from slopecli.errors import InputError
from slopecli.io.files import TEMPORARY, read_file
from slopecli.products.sequence_picture import draw_frame
from slopecli.types import Image

if TYPE_CHECKING:
    from slopecli.sequence.frame import SequenceStep
    from slopecli.sequence.stream import Sequence

RATE = 10.0  # frames a second: the pace at which two numbers can be compared by eye


class Film:
    """Frames drawn one after the other into a file beside the results; `content` gives it when all are in."""

    def __init__(self, folder: str) -> None:
        Path(folder).mkdir(parents=True, exist_ok=True)
        self._path = Path(folder, f"{TEMPORARY}film.mp4")
        self._writer: cv2.VideoWriter | None = None

    def add(self, step: SequenceStep, runner: Sequence) -> None:
        """Add a frame with what is known after it; one that could not be read, or has another size, is left out."""
        image = runner.current
        if not isinstance(image, Image) or (image.width, image.height) != (runner.camera.width, runner.camera.height):
            return
        why = step.state.why
        note = f"{step.state.frame}" if why is None else f"{step.state.frame}: skipped, {why.message}"
        picture = draw_frame(image, step.report, step.motion, runner.camera, note)
        if self._writer is None:
            size = (picture.shape[1], picture.shape[0])
            self._writer = cv2.VideoWriter(str(self._path), cv2.VideoWriter.fourcc(*"mp4v"), RATE, size)
            if not self._writer.isOpened():
                raise InputError("this OpenCV cannot write MP4 files; leave --video out")
        self._writer.write(np.ascontiguousarray(picture))

    def content(self) -> bytes:
        """The bytes of the file so far; none without a frame."""
        if self._writer is None:
            return b""
        self._writer.release()
        return read_file(self._path, "film", 10_000_000_000)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._writer is not None:
            self._writer.release()
        self._path.unlink(missing_ok=True)
