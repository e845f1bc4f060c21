"""Motions of the frames that were used, in the unit of a report, and words on frames that were not."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np

from slopecli.errors import NoAnswer
from slopecli.findings.wording import finding
from slopecli.geometry.epipolar import rotation_angle
from slopecli.sequence.frame import FrameMotion, FrameState
from slopecli.sequence.frame_gates import Skipped
from slopecli.types import Diagnostic, Motion, Report


def motions_of(frames: list[FrameState], report: Report) -> list[FrameMotion]:
    """Motions of all frames used, in the unit of the report, each as it was when its frame came in.

    That of the frame which the report is of is as the report has it: later views may have told more of it.
    """
    last = next(state for state in reversed(frames) if state.status == "used" and not state.later)
    length = float(
        np.linalg.norm(report.motion.baseline_cam1) / np.linalg.norm(np.zeros(3) if last.T is None else last.T)
    )
    found = []
    for state in frames:
        if state.R is None or state.T is None:
            continue
        R, T = state.R, state.T * length
        if state is last:
            R, T = report.motion.rotation_cam2_from_cam1, report.motion.baseline_cam1
        motion = Motion(R, T, float(np.degrees(rotation_angle(R))), None, None)
        found.append(FrameMotion(state.frame, state.image, state.time_s, motion))
    return found


def skipped_notes(frames: list[FrameState]) -> list[Diagnostic]:
    """That frames were skipped, how many, and why."""
    why = [state.why for state in frames if state.why is not None]
    if not why:
        return []
    counts = Counter(one.code for one in why)
    told = ", ".join(f"{count} {code}" for code, count in sorted(counts.items()))
    return [finding("frame-skipped", f"{len(why)} of {len(frames)} frames were not used: {told}", len(why))]


def later_from(frames: list[FrameState], number: int) -> list[FrameState]:
    """The frames, those used after number `number` as followed against it, a later reference."""
    return [
        replace(state, later=True) if state.status == "used" and state.frame > number else state for state in frames
    ]


def without_reference(frames: list[FrameState], why: Skipped) -> list[FrameState]:
    """The frames, the reference among them as skipped, and why."""
    return [
        replace(state, status="skipped", why=why, R=None, T=None) if state.status == "reference" else state
        for state in frames
    ]


def why_no_answer(frames: list[FrameState]) -> NoAnswer:
    """That no frame gives an answer with the first, and for which reason the last one was skipped."""
    why = [state.why for state in frames if state.why is not None]
    last = f": the last of them {why[-1].message}" if why else ""
    parallax = bool(why) and why[-1].code == "parallax"
    return NoAnswer(
        "low-parallax" if parallax else "no-overlap",
        f"none of {len(frames)} frames gives an answer with the first{last}",
        "take frames farther apart" if parallax else "give frames of the same ground",
    )
