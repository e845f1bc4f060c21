"""The camera of a sequence: the focal length that is used, and what its frames say of it, as `estimate` asks a pair."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from slopecli.errors import DegenerateConfiguration, expect
from slopecli.findings.camera_checks import with_aspect
from slopecli.findings.camera_suspicion import suspicion
from slopecli.findings.camera_test import Cameras, CameraTest, examine_cameras
from slopecli.findings.focal_use import focal_note, focal_to_use, prior_sigma, refocused
from slopecli.geometry.solver.intrinsics import Settled, score_camera, with_planes
from slopecli.geometry.solver.solve import solve_planes
from slopecli.options import Options
from slopecli.patches.join import Joined
from slopecli.patches.sightings import sightings_of
from slopecli.sequence.tracking_tunables import TRACKING
from slopecli.solving import contradicted
from slopecli.types import Camera, Diagnostic, Solution


@dataclass(frozen=True, eq=False)
class KnownCamera:
    """The camera as given, and as used: with the focal length that images and `--focal-sigma` agree on at the start.

    focal_sigma : relative 1-sigma of the focal length used, 0 if it is exact.
    test : of all so far the one that tells the focal length best.
    doubts : diagnostics of that test: that the images contradict the camera.
    tested : longest baseline under which it was tested, in first moves; 0 before the first test.
    """

    given: Camera
    used: Camera
    focal_sigma: float
    test: CameraTest = field(default_factory=CameraTest)
    doubts: tuple[Diagnostic, ...] = ()
    tested: float = 0.0

    @classmethod
    def of(cls, camera: Camera, options: Options) -> KnownCamera:
        """The camera given, before its first test; raises WrongArgument where a user gave something else."""
        expect("camera", camera, Camera, "as load_camera returns it")
        expect("options", options, Options, "or none for the defaults")
        return cls(camera, camera, prior_sigma((camera, camera), options))

    @property
    def both(self) -> Cameras:
        """Those of a pair of frames."""
        return self.used, self.used

    def asks(self, baseline: float) -> bool:
        """Whether a frame this far from the first tests the camera: farther than all before, which bounds the cost.

        Not one with a focal length that the first pair was asked for: that is known well then.
        """
        return self.used is self.given and baseline > TRACKING.next_depth * self.tested

    def tested_by(self, joined: Joined, solution: Solution, baseline: float, options: Options) -> KnownCamera:
        """After one more test, by the points that the last frame shows. baseline : of the pair, in first moves.

        A doubt stands until a pair that tells the focal length better has none: of many tests of a right camera one
        errs more often than the best of them. What no focal length explains is a doubt whatever was told before, of a
        pair that tells nearly as much or more.
        """
        if self._tells_less(joined, solution):
            return replace(self, tested=baseline)
        test = examine_cameras(joined, solution, self.both)
        if test.sigma > self.test.sigma and not test.only_contradicted:
            return replace(self, tested=baseline)
        doubts = list[Diagnostic]()
        if contradicted(test, prior_sigma((self.given, self.given), options)):
            doubts = suspicion(test, joined, solution, options, _solved_again, [], can_free=False)
        return replace(self, test=test, doubts=tuple(with_aspect(doubts, self.given)), tested=baseline)

    def _tells_less(self, joined: Joined, solution: Solution) -> bool:
        """Whether the score of a pair tells clearly less of the focal length than that of the best test: a search,
        which changes its sigma by a quarter, would find nothing that counts."""
        if self.test.score is None or not len(joined.patches):
            return False
        try:
            score = score_camera(*with_planes(sightings_of(joined, solution, self.both), Settled.of(solution)))
        except DegenerateConfiguration:
            return False
        return float(score.sigma[0]) > TRACKING.tells_less * float(self.test.score.sigma[0])

    def refocused(self, options: Options) -> KnownCamera:
        """With the focal length that the first pair and the one given agree on, before anything is computed with it."""
        use = focal_to_use(self.test, prior_sigma((self.given, self.given), options), free=False)
        return replace(self, used=refocused((self.given, self.given), use.step)[0], focal_sigma=use.sigma)

    def notes(self, options: Options) -> list[Diagnostic]:
        """What a user should know of the camera."""
        note = focal_note((self.given, self.given), self.both, self.focal_sigma, options)
        return [*self.doubts, *note]


def _solved_again(joined: Joined, cameras: Cameras, start: Settled) -> Solution:
    """Solve the same matches as seen by other cameras, from a motion under these."""
    x1, x2 = joined.matches.x1, joined.matches.x2
    return solve_planes(x1, x2, joined.plane, weights=joined.weight, relief=True, initial=[(start.R, start.T)])
