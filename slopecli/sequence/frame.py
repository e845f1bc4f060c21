"""One frame as it comes in, and what a run of a sequence gives after each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

from slopecli.sequence.frame_gates import Skipped
from slopecli.types import Camera, FloatArray, Image, Motion, Report, Verdict

if TYPE_CHECKING:
    from slopecli.ground.slope_map import SlopeMap


class FramePrior(NamedTuple):
    """What other sensors tell of a frame; None for what they do not.

    position_m : in axes that are the same for all frames.  altitude_m : height above the ground of the windows.
    ned : (3, 3) rotation from camera axes to north, east, down; heading : whether its yaw is known.
    Sigmas: 1-sigma of each of the three numbers of a position, of an altitude, of each angle.
    """

    position_m: tuple[float, float, float] | None = None
    position_sigma_m: float | None = None
    altitude_m: float | None = None
    altitude_sigma_m: float | None = None
    ned: FloatArray | None = None
    heading: bool = False
    attitude_sigma_deg: float | None = None


class Frame(NamedTuple):
    """One frame: its name, image, and time in s, None where that is not known; problem: why there is no image.

    prior : what other sensors tell of it, None where that is nothing.
    camera : None for that of the sequence; of another the frame is resampled, see `look.resampling`.
    """

    name: str
    image: Image | None
    time_s: float | None = None
    problem: str = ""
    prior: FramePrior | None = None
    camera: Camera | None = None


@dataclass(frozen=True, eq=False)
class FrameState:
    """What became of a frame.

    frame : its number, from 1.  image : what it is called.  time_s : when it was taken, None where that is not known.
    status : "reference" (the first), "used" or "skipped"; why : code and words if skipped.
    R, T : of the frame, in axes of the first, unit: the first move; None if it was not used.
    prior : what other sensors tell of it.
    later : it was followed against a later reference, as it shows too little of the windows; it adds a motion only.
    """

    frame: int
    status: Literal["reference", "used", "skipped"]
    image: str = ""
    time_s: float | None = None
    why: Skipped | None = None
    R: FloatArray | None = None
    T: FloatArray | None = None
    prior: FramePrior | None = None
    later: bool = False


@dataclass(frozen=True, eq=False)
class FrameMotion:
    """The motion of a frame that was used, in axes of the first and the unit of the report."""

    frame: int
    image: str
    time_s: float | None
    motion: Motion


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
