"""One frame as it comes in, and what a run of a sequence gives after each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from slopecli.types import Image, Motion, Report, Verdict

if TYPE_CHECKING:
    from slopecli.ground.slope_map import SlopeMap
    from slopecli.sequence.stream import FrameMotion, FrameState


class Frame(NamedTuple):
    """One frame: its name, image, and time in s, None where that is not known; problem: why there is no image.

    position_m : of the camera, in axes that are the same for all frames, m; None where it is not known.
    """

    name: str
    image: Image | None
    time_s: float | None = None
    problem: str = ""
    position_m: tuple[float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class SequenceAnswer:
    """The answer of a sequence: the report of its first frame and the last one used, the motions of all used,
    and the map if one was asked for."""

    report: Report
    motions: tuple[FrameMotion, ...]
    map: SlopeMap | None = None

    @property
    def found(self) -> bool:
        """Whether any plane was found in the image: none, they are windows."""
        return self.report.found

    @property
    def segmentation(self) -> None:
        """There are no steps of a segmentation."""
        return


class SequenceStep(NamedTuple):
    """After one frame: what became of it, the report if it changed the answer, and windows by id that are settled.

    motion : of the frame, None if it was not used.
    """

    state: FrameState
    report: Report | None
    settled: dict[int, Verdict]
    motion: Motion | None = None
