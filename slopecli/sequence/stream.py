"""`Sequence`: frames in, the answer so far out. One frame costs the same, the hundredth as the third."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from slopecli.errors import InputError, NoAnswer, SlopemapError
from slopecli.findings.metadata_checks import metadata_notes
from slopecli.findings.pair_checks import still_notes
from slopecli.geometry.solver.many_views import ViewsSolution
from slopecli.geometry.solver.one_thread import one_blas_thread
from slopecli.geometry.solver.resection import Motion as Placed
from slopecli.ground.slope_map import SlopeMap
from slopecli.look.dense_depth import DEPTH, DenseDepth
from slopecli.look.features import QUICK, FeatureMemory, Grey
from slopecli.look.resampling import resampled
from slopecli.look.standing_still import Still, without_still
from slopecli.look.threads import single_threaded
from slopecli.options import Options
from slopecli.patches.windows.window_finder import wanted_windows
from slopecli.sequence import used_frames
from slopecli.sequence.depth_frames import DepthFrames, FusedScene
from slopecli.sequence.first_answer import first_answer, reference_of
from slopecli.sequence.frame import Frame, FrameMotion, FramePrior, FrameState, SequenceAnswer
from slopecli.sequence.frame_alignment import Aligner
from slopecli.sequence.frame_gates import FrameGates, Skipped
from slopecli.sequence.frame_priors import prior_notes, turn_known, with_priors, with_source
from slopecli.sequence.known_camera import KnownCamera
from slopecli.sequence.later_reference import Follower, LaterReference, ReferenceCandidate
from slopecli.sequence.sequence_report import Reported, report_of, tested_by_last_view
from slopecli.sequence.tracking_tunables import TRACKING
from slopecli.types import Camera, Image, ImageInfo, Report

# what a frame can break: a step of numbers, or one of OpenCV, or what is raised on purpose; all else is a fault of ours
BROKEN_STEP = (ArithmeticError, np.linalg.LinAlgError, cv2.error, SlopemapError)


class Sequence:
    """Slopes of windows of the first frame from all frames so far.

    Parameters
    ----------
    camera : of every frame.  options : windows are in px of the first frame that is used.
    keep_depth : keep the few frames that `fused` needs.
    options_of : of the names of the first frame used and the last: options of what is reported of the two, in which
    `baseline_m` is the distance between them; for what depends on the frames, such as their metadata.
    """

    def __init__(
        self,
        camera: Camera,
        options: Options | None = None,
        *,
        keep_depth: bool = False,
        options_of: Callable[[str, str], Options] | None = None,
    ) -> None:
        self.options, self.options_of = options or Options(), options_of
        self._camera = KnownCamera.of(camera, self.options)
        self.windows = wanted_windows(self.options, camera.width, camera.height)
        self.frames: list[FrameState] = []
        self._gates = FrameGates((camera.height, camera.width))
        self._memory = FeatureMemory()
        self._aligner: Aligner | None = None
        self._still: Still | None = None  # what stands still, painted over in all frames
        self._unrelated = 0  # frames that do not show what the first one shows, before there is an answer
        self._first: Follower | None = None  # what follows the reference; it has the answer
        self._later: Follower | None = None  # what follows a later reference, which took its place
        self._next: ReferenceCandidate | LaterReference | None = None
        self._depth = DepthFrames() if keep_depth else None
        self._depth_then: DepthFrames | None = None  # as of the frame that is to be the next reference
        self.current: Image | None = None
        self._reference_image: Image | ImageInfo = ImageInfo("", camera.width, camera.height, "")
        self._infos: dict[int, ImageInfo] = {}  # of frames used, by number

    @property
    def camera(self) -> Camera:
        """The camera that slopes are computed with."""
        return self._camera.used

    @property
    def focal_sigma(self) -> float:
        """Relative 1-sigma of its focal length that the answer holds."""
        return self._camera.focal_sigma

    @one_blas_thread()
    @single_threaded()
    def add(
        self, grey: Grey, image: str = "", time_s: float | None = None, prior: FramePrior | None = None
    ) -> FrameState:
        """Take in the next frame (h, w) uint8; never raises for what a frame shows: it is skipped, and why is said."""
        frame = np.ascontiguousarray(grey)
        if self._unrelated >= TRACKING.in_turn:
            self._forget_reference()
        why = self._gates.check(frame)
        state = FrameState(len(self.frames) + 1, "skipped", why=why) if why else self._taken_or_skipped(frame)
        if state.status != "skipped":
            self._gates.accept(frame)
        elif self._first is None and state.why is not None and state.why.code in ("foreign", "blurred"):
            self._unrelated += 1
        used = state.status == "used" and not state.later
        if used and self._depth is not None and state.R is not None and state.T is not None:
            self._depth.add(without_still(frame, self._still), state.R, state.T)
            if self._next is not None and self._next.number == state.frame:
                self._depth_then = self._depth.kept()
        self.frames.append(replace(state, image=image, time_s=time_s, prior=prior))
        if used and self._first is not None and (turn := turn_known(self._used[0].prior, prior)):
            self._first.estimator.decide(*turn)
        return self.frames[-1]

    @property
    def _used(self) -> list[FrameState]:
        return [state for state in self.frames if state.status != "skipped"]

    def _forget_reference(self) -> None:
        """Begin anew with the next frame: those after the first one do not show its ground, or it was no good."""
        why = Skipped("foreign", "shows other ground than the frames after it")
        self.frames = used_frames.without_reference(self.frames, why)
        self._gates = FrameGates((self.camera.height, self.camera.width))
        self._aligner, self._unrelated = None, 0

    def _taken_or_skipped(self, frame: Grey) -> FrameState:
        """Take in a frame; one whose numbers break a step is skipped, and the answer is as before.

        So it is before a fault of the program is raised, too: a caller may keep what the frames before it told.
        """
        current = self._later or self._first
        held = None if current is None else current.estimator.kept()
        try:
            return self._placed(frame)
        except Exception as problem:
            if current is None or held is None:
                self._first = None
            else:
                current.estimator.restore(held)
            if not isinstance(problem, BROKEN_STEP):
                raise
            why = Skipped("foreign", f"cannot be followed: {' '.join(str(problem).split())}")
            return FrameState(len(self.frames) + 1, "skipped", why=why)

    def _placed(self, frame: Grey) -> FrameState:
        """The state with a frame that is made the reference, or whose motion is found against it."""
        number = len(self.frames) + 1
        frame = without_still(frame, self._still)
        if self._aligner is None:
            reference = reference_of(frame, self.windows, self.camera)
            if isinstance(reference, Skipped):
                return FrameState(number, "skipped", why=reference)
            self._aligner = reference
            self._memory.detect(frame, QUICK)  # for the first pair, whose frame then has less to do
            return FrameState(number, "reference", R=np.eye(3), T=np.zeros(3))
        found = self._started(frame) if self._first is None else self._followed(frame)
        if isinstance(found, Skipped):
            return FrameState(number, "skipped", why=found)
        return FrameState(number, "used", R=found[0], T=found[1], later=self._later is not None)

    def _started(self, frame: Grey) -> Placed | Skipped:
        """The first move, if this frame is far enough from the first."""
        known = self._camera, self.options, self._memory, self._gates
        begun = first_answer(frame, self._reference(), self.windows, *known)
        if isinstance(begun, Skipped):
            return begun
        self._first, self._camera, self._still = begun
        self._aligner = self._first.aligner
        return self._first.estimator.motion

    def _followed(self, frame: Grey) -> Placed | Skipped:
        """The motion of a frame of a running sequence, against the first; a later reference is taken where need be."""
        current = self._later or self._first
        if current is None:
            raise InputError("the sequence has not started")
        found = current.follow(frame, self._gates)
        if isinstance(found, Skipped):
            return found
        motion, camera = current.in_first(found), self._camera
        # not while a new reference is taken: that needs the time of two frames by itself
        same_reference = current is self._first and self._next is None and not current.is_left
        if same_reference and camera.asks(float(np.linalg.norm(motion[1]))):
            camera = tested_by_last_view(camera, current.estimator, self.windows, self.options)
        self._towards_next(frame, motion, current)
        self._camera = camera
        return motion

    def _towards_next(self, frame: Grey, motion: Placed, current: Follower) -> None:
        """Choose a later reference, prepare it, begin with it: a step a frame, as each takes the time of a frame.

        Where frames are far apart it is prepared at once: the next may show all it needs, and the one after not.
        """
        if isinstance(self._next, ReferenceCandidate):
            self._next = self._next.prepared(self.camera, self.windows)
        elif self._next is not None:
            begun = self._next.begun(frame, motion, self.camera)
            if begun is not None:
                self._change_reference(current, self._next, begun)
        elif current.is_left and not current.estimator.is_open:
            self._next = ReferenceCandidate.of(len(self.frames) + 1, frame, current, motion)
            if self._next is not None and current.moves_far:
                self._next = self._next.prepared(self.camera, self.windows)

    def _change_reference(self, current: Follower, reference: LaterReference, begun: Follower) -> None:
        """Go on from a later reference: the earlier one's views end with it, so that none counts twice."""
        current.estimator.restore(reference.held)
        self.frames = used_frames.later_from(self.frames, reference.number)
        self._later, self._next, self._depth = begun, None, self._depth_then or self._depth
        self._gates.forget_detail()

    def _reference(self) -> Aligner:
        if self._aligner is None:
            raise InputError("no frame was taken yet")
        return self._aligner

    @property
    def started(self) -> bool:
        """Whether there is an answer."""
        return self._first is not None

    @property
    def carries(self) -> bool:
        """Whether windows of the first frame are followed in a later reference."""
        return self._later is not None and len(self._later.windows) > 0

    def solution(self) -> ViewsSolution:
        """Motions of the views kept and normals of all windows, with covariance and a second root if one is left.

        Once a later reference has taken the place of the first: as of `last_view`.
        """
        return self._answered()[0]

    def _answered(self) -> tuple[ViewsSolution, int]:
        """The solution, and the number of its view that reports are of."""
        if self._first is None:
            raise InputError("there is no answer yet: no frame has moved far enough from the first")
        first = self._first.estimator
        found, view = (first.solution(), -1) if self._later is None else (self._later.known(), 0)
        return first.with_shared_errors(found), view

    def take(self, frame: Frame) -> FrameState:
        """Take in a frame with its name and time; one that could not be read is skipped."""
        if frame.image is not None and frame.camera not in (None, self._camera.given):
            frame = frame._replace(image=resampled(frame.image, frame.camera, self._camera.given))
        self.current = frame.image
        if frame.image is None:
            unread = Skipped("unread", frame.problem)
            self.frames.append(FrameState(len(self.frames) + 1, "skipped", frame.name, frame.time_s, unread))
            return self.frames[-1]
        state = self.add(frame.image.grey, frame.name, frame.time_s, frame.prior)
        if state.status == "reference":
            self._reference_image = frame.image
        if state.status != "skipped":
            self._infos[state.frame] = _named(frame.image)
        return state

    def answer(self, report: Report | None = None, slope_map: SlopeMap | None = None) -> SequenceAnswer:
        """The answer so far, or that of a report of it, with the motions of all frames used.

        Raises
        ------
        NoAnswer : there is none, with the reason for which the last frame was skipped.
        """
        if self._first is not None:
            report = report or self.report(self.images)
            return SequenceAnswer(report, tuple(self.motions(report)), slope_map)
        raise used_frames.why_no_answer(self.frames)

    def report_or_none(self) -> Report | None:
        """The answer so far; None while no slope is known."""
        try:
            return self.report((_named(self.images[0]), _named(self.images[1])))
        except NoAnswer:
            return None

    @property
    def images(self) -> tuple[Image | ImageInfo, Image | ImageInfo]:
        """The first frame that was used, and what is known of the last one that shows its points."""
        last = next((state for state in reversed(self.frames) if state.status != "skipped" and not state.later), None)
        first = self._reference_image
        return first, _named(first) if last is None else self._infos.get(last.frame, _named(first))

    def report(self, images: tuple[Image | ImageInfo, Image | ImageInfo] | None = None) -> Report:
        """The answer so far as a report of the first frame and the last one used; arguments as of `reported`."""
        return self.reported(images).report

    @property
    def has_depth(self) -> bool:
        """Whether `fused` has an answer."""
        return self._first is not None and self._depth is not None

    def fused(self, max_pixels: float = DEPTH.most_pixels) -> FusedScene:
        """Depth of every pixel of the first frame from those that tell most of it; see `keep_depth`.

        max_pixels : that are measured; of a larger image every so many.

        Raises
        ------
        InputError : there is no answer yet, or no frames were kept.
        """
        if self._first is None or self._depth is None:
            raise InputError("there is no depth: no frame has moved far enough, or Sequence has no keep_depth")
        estimator = self._first.estimator
        state, system = estimator.best.root.state, estimator.best.root.system
        known = estimator.alive & (system.V > 0.0)
        aligner = self._reference()
        return self._depth.fused(aligner.grey, self.camera, aligner.tracks, state.u, known, max_pixels, self._still)

    def reported(
        self, images: tuple[Image | ImageInfo, Image | ImageInfo] | None = None, depth: DenseDepth | None = None
    ) -> Reported:
        """The answer so far as a report of the first frame and the last one used.

        images : both, for their names and what the first shows; names alone where they are not given.
        depth : of `fused`, for planes of rough windows through all pixels.

        Raises
        ------
        InputError : there is no answer yet.  NoAnswer : no window has a slope that is known.
        """
        if self._first is None:
            raise InputError("there is no answer yet: no frame has moved far enough from the first")
        used, size = self._used, (self.camera.width, self.camera.height)
        named = images or (
            ImageInfo(used[0].image, *size, ""),
            ImageInfo([one for one in used if not one.later][-1].image, *size, ""),
        )
        views, shown = self._answered()
        options, baseline = self.options_now, float(np.linalg.norm(views.T[shown]))
        if options.baseline_m and options.stated and options.stated.scale:
            options = replace(options, baseline_m=options.baseline_m / baseline)
        notes = [*still_notes(self._still), *metadata_notes(options), *prior_notes(used)]
        notes += used_frames.skipped_notes(self.frames)
        pair, estimator = views.pair(shown), self._first.estimator
        found = report_of(estimator, pair, self.windows, named, self._camera, options, notes, baseline, depth)
        return found._replace(report=with_source(found.report, self.options, used))

    @property
    def options_now(self) -> Options:
        """The options of what is reported now: of the first frame used and the last, where they depend on these."""
        options = self.options if self.options_of is None else self.options_of(*(image.path for image in self.images))
        return options if self._first is None else with_priors(options, self._used, self._first.estimator)

    def motions(self, report: Report) -> list[FrameMotion]:
        """Motions of all frames used, in the unit of the report, each as it was when its frame came in."""
        return used_frames.motions_of(self.frames, report)


def _named(image: Image | ImageInfo) -> ImageInfo:
    """What a report says of an image, without its pixels."""
    return ImageInfo(image.path, image.width, image.height, image.sha256)
