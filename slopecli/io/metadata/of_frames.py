"""What the metadata of the frames of a sequence state, as options of the pair of its first frame and its last."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

from slopecli.io.metadata.applied import apply_metadata
from slopecli.io.metadata.image_metadata import Metadata
from slopecli.options import CameraChoice, MetadataChoice, Options

OptionsOf = Callable[[str, str], Options]


def options_of_frames(
    read_frame: Callable[[str], Metadata], choice: MetadataChoice, options: Options, camera: CameraChoice
) -> tuple[OptionsOf, OptionsOf]:
    """Functions of the names of the first frame used and the last: options while frames come in, and at the end.

    The positions of the first frames may be too near to each other for a baseline, so that only the end refuses a
    lack of it; what the first frame alone has to state is refused by either.
    """
    read = lru_cache(maxsize=2)(read_frame)  # of the first frame and the last
    later = {"baseline", "altitude"} & set(choice.must)
    while_running = replace(
        choice, must=tuple(set(choice.must) - later), may=tuple(dict.fromkeys((*choice.may, *sorted(later))))
    )

    def of(wanted: MetadataChoice, first: str, last: str) -> Options:
        return apply_metadata((read(first), read(last)), wanted, options, (camera, camera))

    def running(first: str, last: str) -> Options:
        """Options while frames come in; what no later frame can bring is refused."""
        hopeless = "baseline" in choice.must and read(first).position is None
        return of(choice if hopeless else while_running, first, last)

    return running, lambda first, last: of(choice, first, last)
