"""Whether the motion that the images show is the one that their metadata state: positions, and angles of the gimbal."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from slopecli.findings.facts import AnswerFacts, PairFacts
from slopecli.findings.wording import finding
from slopecli.geometry.attitude import about_line_of_sight, forward_angles_deg
from slopecli.geometry.epipolar import direction_angle, rotation_angle
from slopecli.options import Options, Stated
from slopecli.types import Diagnostic, FloatArray, Solution


class Agreement(NamedTuple):
    """What counts as a contradiction.

    sigmas : beyond which two statements differ by more than chance.  tells_deg : 1-sigma, degrees, up to which a
    statement tells one quarter turn from the next.  places_m : between two places of one camera, beyond any receiver.
    """

    sigmas: float = 4.0
    tells_deg: float = 15.0
    places_m: float = 1000.0


AGREES = Agreement()


def metadata_taken(pair: PairFacts) -> list[Diagnostic]:
    """Say what was taken from the metadata of the images, and what is missing there."""
    return metadata_notes(pair.options)


def metadata_notes(options: Options) -> list[Diagnostic]:
    """What was taken from the metadata, and what is missing there, as findings."""
    stated = options.stated
    return [] if stated is None else [*(finding("metadata", note) for note in stated.notes), *_given_otherwise(stated)]


def _given_otherwise(stated: Stated) -> list[Diagnostic]:
    """Warn of an up, or a position, that was given and that image 1 states otherwise; what was given is used."""
    found, off, sigma = [], stated.up_off_deg, stated.up_off_sigma_deg
    if off is not None and sigma is not None and off > AGREES.sigmas * sigma:
        message = f"the direction given as up is {off:.0f}° off the one that image 1 states (1-sigma {sigma:.2g}°)"
        remedy = (
            "check the sign of --pitch (-90 looks straight down) and the axes of --up; --up exif takes what is stated"
        )
        found.append(finding("metadata-contradicted", message, off, remedy))
    if stated.position_off_m is not None and stated.position_off_m > AGREES.places_m:
        message = f"the position given is {stated.position_off_m / 1e3:.3g} km from the one that image 1 states"
        found.append(finding("position-contradicted", message, stated.position_off_m))
    return found


def contradicted(facts: AnswerFacts) -> list[Diagnostic]:
    """Warn of a motion that is not the stated one, and say which image seems to be turned."""
    stated = facts.options.stated
    if stated is None or stated.attitude1 is None:
        return []
    solution = facts.solution
    other = solution.ambiguity.alternative if solution.ambiguity.status == "unresolved" else None
    roots = [solution] if other is None else [solution, other]
    first = min((_differences(root, stated, 0, 0) for root in roots), key=lambda two: two.worst)
    if first.worst <= 1.0:
        return []
    for turns in _turns():
        if any(_differences(root, stated, *turns).worst <= 1.0 for root in roots):
            message, remedy = _turned(turns, stated)
            return [finding("metadata-contradicted", f"{first.words(stated)}; {message}", first.value, remedy)]
    message = f"{first.words(stated)}; no turn of an image explains it"
    return [finding("metadata-contradicted", message, first.value)]


def root_stated(facts: AnswerFacts) -> list[Diagnostic]:
    """Say which of two motions is the one that the positions state, and how to let them decide."""
    stated, both = facts.options.stated, facts.solution.ambiguity
    if both.status != "unresolved" or both.alternative is None or stated is None or stated.attitude1 is None:
        return []
    first, second = (_differences(root, stated, 0, 0).worst <= 1.0 for root in (facts.solution, both.alternative))
    if first == second or stated.move_m is None or not _tells_move(stated):
        return []
    x, y, z = _matrix(stated.attitude1).T @ np.array(stated.move_m) / np.linalg.norm(stated.move_m)
    message = f"of the two motions the {'first' if first else 'second'} goes from one GPS position to the other"
    remedy = f"--direction-prior {x:.3f},{y:.3f},{z:.3f},{stated.move_sigma_deg:.2g} lets them decide"
    return [finding("metadata", message, None, remedy)]


def _turned(turns: tuple[float, float], stated: Stated) -> tuple[str, str]:
    """Which images seem to be turned, by how much, and what to do; turns: of images 1 and 2, degrees."""
    by = " and ".join(f"{turn:.0f}°" for turn in dict.fromkeys(turns) if turn)
    one = "image 1" if turns[0] else "image 2"
    if all(turns):
        message = f"both images seem to have been turned by {by} after they were taken"
        remedy = "give both as the camera wrote them"
    else:
        one = one if _tells_move(stated) else "one of the images"
        message = f"{one} seems to have been turned by {by} after it was taken"
        remedy = f"give {one} as the camera wrote it"
    if turns[0] and _tells_move(stated):
        shown = about_line_of_sight(turns[0] - stated.shown_turn_deg)
        yaw, pitch, roll = forward_angles_deg(_matrix(stated.attitude1) @ shown)
        remedy += f", or say how image 1 is turned: --yaw {yaw:.4g} --pitch {pitch:.4g} --roll {roll:.4g}"
    return message, remedy


class _Differences(NamedTuple):
    """Angles, degrees, between what is seen and what is stated, and their share of the largest that agrees."""

    move_deg: float
    move_share: float
    turn_deg: float
    turn_share: float

    @property
    def worst(self) -> float:
        return max(self.move_share, self.turn_share)

    @property
    def value(self) -> float:
        """The angle that does not agree, degrees."""
        return self.move_deg if self.move_share > 1.0 else self.turn_deg

    def words(self, stated: Stated) -> str:
        """What differs, as a sentence."""
        parts = []
        if self.move_share > 1.0:
            parts.append(
                f"the images show a motion {self.move_deg:.0f}° off the direction from one GPS position to the other "
                f"(1-sigma {stated.move_sigma_deg:.2g}°)"
            )
        if self.turn_share > 1.0:
            parts.append(
                f"the images are turned against each other by {self.turn_deg:.0f}° more than their angles say "
                f"(1-sigma {stated.attitude_sigma_deg:.2g}°)"
            )
        return ", and ".join(parts)


def _differences(root: Solution, stated: Stated, turn1: float, turn2: float) -> _Differences:
    """Compare a root with what is stated, if images 1 and 2 had been turned by these angles, degrees."""
    first = _matrix(stated.attitude1) @ about_line_of_sight(turn1)
    move_deg = turn_deg = move_share = turn_share = 0.0
    if stated.move_m is not None and _tells_move(stated):
        move_deg = float(np.degrees(direction_angle(root.T, first.T @ np.array(stated.move_m))))
        move_share = move_deg / (AGREES.sigmas * stated.move_sigma_deg)
    if stated.attitude2 is not None:
        second = _matrix(stated.attitude2) @ about_line_of_sight(turn2)
        turn_deg = float(np.degrees(rotation_angle(root.R @ (second.T @ first).T)))
        turn_share = turn_deg / (AGREES.sigmas * stated.attitude_sigma_deg)
    return _Differences(move_deg, move_share, turn_deg, turn_share)


def _tells_move(stated: Stated) -> bool:
    """Whether the positions are known well enough to tell quarter turns of image 1."""
    return stated.move_m is not None and stated.move_sigma_deg <= AGREES.tells_deg


def _turns() -> Iterator[tuple[float, float]]:
    """Quarter turns of the two images, those of one image first."""
    quarters = (0.0, 180.0, 90.0, 270.0)
    yield from sorted(product(quarters, quarters), key=lambda two: (two[0] > 0) + (two[1] > 0))


def _matrix(rows: tuple[float, ...] | None) -> FloatArray:
    return np.array(rows, float).reshape(3, 3)
