"""The first answer of a sequence: the first move, the test of the camera by it, and what follows the reference."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from slopecli.look.features import FeatureMemory, Grey
from slopecli.options import Options
from slopecli.sequence.coarse_motion import CoarseMotion
from slopecli.sequence.first_move import first_move
from slopecli.sequence.frame_alignment import Aligner
from slopecli.sequence.frame_gates import Skipped
from slopecli.sequence.known_camera import KnownCamera
from slopecli.sequence.later_reference import Follower
from slopecli.sequence.sequence_report import tested_by_last_view
from slopecli.sequence.tracks import choose_tracks
from slopecli.sequence.view_estimator import ViewEstimator
from slopecli.windows import Window


class FirstAnswer(NamedTuple):
    """What follows the reference from the first move on, and the camera that was used."""

    follower: Follower
    camera: KnownCamera


def first_answer(
    frame: Grey, aligner: Aligner, windows: list[Window], camera: KnownCamera, options: Options, memory: FeatureMemory
) -> FirstAnswer | Skipped:
    """The first answer by a frame, or why it gives none."""
    begun = _followed(frame, aligner, camera, memory)
    if isinstance(begun, Skipped):
        return begun
    known = tested_by_last_view(camera, begun.estimator, windows, options).refocused(options)
    if known.used is not camera.used:  # begin again with the focal length that the images and its sigma agree on
        anew = Aligner(aligner.grey, known.used, windows, choose_tracks(aligner.grey, windows, known.used))
        begun = _followed(frame, anew, known, memory)
    return begun if isinstance(begun, Skipped) else FirstAnswer(begun, known)


def _followed(frame: Grey, aligner: Aligner, camera: KnownCamera, memory: FeatureMemory) -> Follower | Skipped:
    move = first_move(aligner.grey, frame, camera.used, aligner, memory)
    if isinstance(move, Skipped):
        return move
    estimator = ViewEstimator(aligner.tracks, camera.used.focal_px)
    estimator.start(move.found, move.solution)
    # once more under the planes found: what is left is smaller than under the depths of single points
    found = aligner.find(frame, estimator.motion, estimator.normals, estimator.inverse_depth, estimator.alive)
    estimator.found_again(found)
    coarse = CoarseMotion(camera.used, aligner.tracks, aligner.grey, memory)
    coarse.accept(frame, estimator.motion)
    return Follower(aligner, estimator, coarse, np.eye(3), np.zeros(3), 1.0, None, 1.0)
