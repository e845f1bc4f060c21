"""Camera files with several cameras, in a sequence: every frame has the camera of its name."""

from __future__ import annotations

from collections.abc import Iterator

from slopecli.errors import InputError
from slopecli.io.cameras.reading import CamerasHeld, beside, camera_for, read_camera_file, split_name
from slopecli.options import CameraChoice
from slopecli.sequence.frame import Frame
from slopecli.types import Camera


class FrameCameras:
    """The camera of every frame by its name, where the file of a choice holds several; else none is named."""

    def __init__(self, choice: CameraChoice) -> None:
        self._held: CamerasHeld | None = None
        self._file = choice.file or ""
        self._known: dict[tuple[str, int, int], Camera] = {}
        if choice.file and split_name(choice.file)[1] is None:
            held = CamerasHeld(read_camera_file(choice.file), choice.file, beside(choice.file))
            self._held = held if len(held.cameras) > 1 else None

    @property
    def several(self) -> bool:
        """Whether frames may have cameras of their own."""
        return self._held is not None

    def of(self, frames: Iterator[Frame]) -> Iterator[Frame]:
        """The frames with their cameras; one whose camera is not told is as if it could not be read."""
        for frame in frames:
            if self._held is None or frame.image is None:
                yield frame
                continue
            try:
                name = self._held.of_image(frame.image.path)
                if name is None:
                    raise InputError(f"{self._file} has no camera for it")
                key = name, frame.image.width, frame.image.height
                if key not in self._known:
                    self._known[key] = camera_for(frame.image, CameraChoice(file=f"{self._file}#{name}"))[0]
                yield frame._replace(camera=self._known[key])
            except InputError as error:
                yield frame._replace(image=None, problem=str(error).removeprefix(f"{frame.name}: "))
