"""The first answer of a sequence: the first move, the test of the camera by it, and what follows the reference."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopecli.look.features import FeatureMemory, Grey
from slopecli.look.standing_still import Still, find_still
from slopecli.options import Options
from slopecli.sequence.coarse_motion import CoarseMotion
from slopecli.sequence.first_move import first_move
from slopecli.sequence.frame_alignment import Aligner
from slopecli.sequence.frame_gates import FrameGates, Skipped
from slopecli.sequence.known_camera import KnownCamera
from slopecli.sequence.later_reference import Follower
from slopecli.sequence.sequence_report import tested_by_last_view
from slopecli.sequence.tracks import choose_tracks
from slopecli.sequence.view_estimator import ViewEstimator
from slopecli.types import Camera
from slopecli.windows import Window


class FirstAnswer(NamedTuple):
    """What follows the reference from the first move on, the camera that was used, and what stands still in both frames
    and was left out."""

    follower: Follower
    camera: KnownCamera
    still: Still | None


def reference_of(frame: Grey, windows: list[Window], camera: Camera) -> Aligner | Skipped:
    """What aligns frames with a reference; why there is none, if nothing in its windows can be followed."""
    tracks = choose_tracks(frame, windows, camera)
    if not len(tracks) or (tracks.patch < 0).all():
        return Skipped("dark", "has no texture in any window")
    return Aligner(frame, camera, windows, tracks)


def first_answer(
    frame: Grey,
    aligner: Aligner,
    windows: list[Window],
    camera: KnownCamera,
    options: Options,
    memory: FeatureMemory,
    gates: FrameGates,
) -> FirstAnswer | Skipped:
    """The first answer by a frame, or why it gives none."""
    if (still := find_still(aligner.grey, frame)) is not None:
        rest = reference_of(still.painted(aligner.grey), windows, camera.used)
        if isinstance(rest, Skipped):
            return rest
        aligner, frame = rest, still.painted(frame)
    begun = _followed(frame, aligner, camera, memory, gates)
    if isinstance(begun, Skipped):
        return begun
    known = tested_by_last_view(camera, begun.estimator, windows, options).refocused(options)
    if known.used is not camera.used:  # begin again with the focal length that the images and its sigma agree on
        anew = Aligner(aligner.grey, known.used, windows, choose_tracks(aligner.grey, windows, known.used))
        begun = _followed(frame, anew, known, memory, gates)
    return begun if isinstance(begun, Skipped) else FirstAnswer(begun, known, still)


def _followed(
    frame: Grey, aligner: Aligner, camera: KnownCamera, memory: FeatureMemory, gates: FrameGates
) -> Follower | Skipped:
    move = first_move(aligner.grey, frame, camera.used, aligner, memory, gates)
    if isinstance(move, Skipped):
        return move
    estimator = ViewEstimator(aligner.tracks, camera.used.focal_px)
    estimator.start(move.found, move.solution)
    # once more under the planes found: what is left is smaller than under the depths of single points
    found = aligner.find(frame, estimator.motion, estimator.normals, estimator.inverse_depth, estimator.alive)
    estimator.found_again(found, rounds=2)
    coarse = CoarseMotion(camera.used, aligner.tracks, aligner.grey, memory)
    coarse.accept(frame, estimator.motion)
    return Follower(aligner, estimator, coarse, np.eye(3), np.zeros(3), 1.0, None, 1.0)
