"""Normals that views of a later reference image tell, brought into the axes of the first one and joined with its own.

A plane N.P = 1 of the first reference is R N / (1 - N.T) for a camera at the motion (R, T). That camera's own unit of
length is known roughly at most, so it is one more unknown: directions are what the later views add. All is linear about
the answers of the two solutions, which are independent but for the motion of the later reference, one of the unknowns.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from slopecli.geometry.epipolar import rotation_from_vector, skew
from slopecli.geometry.solver.many_views import ViewsSolution
from slopecli.geometry.statistics import CHI2
from slopecli.types import BoolArray, FloatArray, IntArray

# coordinates of two motions, a rotation vector and a position each, and those of the second one
PART = {"shown": slice(0, 6), "reference": slice(6, 12), "turn": slice(6, 9), "shift": slice(9, 12)}


class LaterViews(NamedTuple):
    """What views of a later reference tell.

    solution : in its own axes and unit.  planes (c,) : plane of the first reference that each of its first c planes is.
    unit : its unit of length in that of the first reference.
    parts (c, 3, 3) : covariance by which its planes may differ from those of the first, as they are of parts of them.
    """

    solution: ViewsSolution
    planes: IntArray
    unit: float
    parts: FloatArray


def last_view(solution: ViewsSolution) -> ViewsSolution:
    """The last view, twice, and the normals, with their joint covariance; the other views are left out.

    The first of the two is what answers are reported for; the second is the reference of later views.
    """
    motion = solution.basis[-6:]
    m = len(solution.scaled_normals)
    J = np.concatenate([motion, motion, solution.normal_gain.reshape(3 * m, -1)])
    covariance = J @ solution.motion_covariance @ J.T
    for i, own in enumerate(solution.own_covariance):
        rows = slice(PART["reference"].stop + 3 * i, PART["reference"].stop + 3 * i + 3)
        covariance[rows, rows] += own
    both = replace(solution, R=solution.R[[-1, -1]], T=solution.T[[-1, -1]])
    return _with_coordinates(both, covariance)


def with_later_views(known: ViewsSolution, later: LaterViews) -> ViewsSolution:
    """What is known of the normals, and of two views, with later views of the second of them as a reference.

    known : as of `last_view`, or of this.

    Returns
    -------
    joined : its first view is that of `known`, its second one the last view of the later reference.
    """
    own = later.solution
    count, d = len(known.motion_covariance), len(own.motion_covariance)
    P = np.zeros((count + 1 + d, count + 1 + d))
    P[:count, :count], P[count, count] = known.motion_covariance, later.unit**2
    P[count + 1 :, count + 1 :] = own.motion_covariance
    H, off, noise = _compared(known, later)
    kept = np.repeat(_agreeing(H @ P @ H.T + noise, off), 3)
    H, off, noise = H[kept], off[kept], noise[np.ix_(kept, kept)]
    gain = np.linalg.solve(H @ P @ H.T + noise, H @ P).T
    move, P = gain @ off, P - gain @ (H @ P)
    return _moved(known, later, move, 0.5 * (P + P.T))


def _compared(known: ViewsSolution, later: LaterViews) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Derivatives (3c, .) of the planes as the later reference has them, by the coordinates of `known`, its unit and
    the coordinates of the later solution; how far (3c,) it finds them off; and the covariance (3c, 3c) of that."""
    R, T, m = known.R[1], known.T[1], len(known.scaled_normals)
    count, own = PART["reference"].stop + 3 * m, later.solution
    c = len(later.planes)
    H = np.zeros((3 * c, count + 1 + len(own.motion_covariance)))
    off, noise = np.zeros(3 * c), np.zeros((3 * c, 3 * c))
    for j, plane in enumerate(later.planes.tolist()):
        rows, N = slice(3 * j, 3 * j + 3), known.scaled_normals[plane]
        ahead = 1.0 - float(N @ T)
        seen = later.unit * (R @ N) / ahead
        H[rows, PART["turn"]] = -skew(seen)
        H[rows, PART["shift"]] = np.outer(seen, N) / ahead
        first = PART["reference"].stop + 3 * plane
        H[rows, first : first + 3] = (later.unit * R + np.outer(seen, T)) / ahead
        H[rows, count] = seen / later.unit
        H[rows, count + 1 :] = -own.normal_gain[j]
        off[rows] = own.scaled_normals[j] - seen
        noise[rows, rows] = own.own_covariance[j] + later.parts[j]
    return H, off, noise


def _agreeing(spread: FloatArray, off: FloatArray) -> BoolArray:
    """(c,) planes whose difference (3c,) is within its covariance (3c, 3c): right normals, but for one in 1000."""
    blocks = [slice(k, k + 3) for k in range(0, len(off), 3)]
    return np.array([off[b] @ np.linalg.solve(spread[b, b], off[b]) < CHI2[3, 0.999] for b in blocks], bool)


def _moved(known: ViewsSolution, later: LaterViews, move: FloatArray, P: FloatArray) -> ViewsSolution:
    """The joined solution: a step `move` of all coordinates away from the two, with their covariance P."""
    count, m, own = len(known.motion_covariance), len(known.scaled_normals), later.solution
    of_last = own.basis[-6:]
    first, ref, last = move[PART["shown"]], move[PART["reference"]], of_last @ move[count + 1 :]
    R, T = rotation_from_vector(ref[:3]) @ known.R[1], known.T[1] + ref[3:]
    R_last, T_last = rotation_from_vector(last[:3]) @ own.R[-1], own.T[-1] + last[3:]
    unit = later.unit + float(move[count])
    J = np.zeros((count, len(P)))
    J[PART["shown"], PART["shown"]] = np.eye(6)
    J[PART["turn"], PART["turn"]], J[PART["turn"], count + 1 :] = R_last, of_last[:3]
    J[PART["shift"], PART["turn"]], J[PART["shift"], PART["shift"]] = unit * R.T @ skew(T_last), np.eye(3)
    J[PART["shift"], count], J[PART["shift"], count + 1 :] = R.T @ T_last, unit * R.T @ of_last[3:]
    J[PART["reference"].stop :, PART["reference"].stop : count] = np.eye(3 * m)
    joined = replace(
        known,
        R=np.stack([rotation_from_vector(first[:3]) @ known.R[0], R_last @ R]),
        T=np.stack([known.T[0] + first[3:], T + unit * R.T @ T_last]),
        scaled_normals=known.scaled_normals + move[PART["reference"].stop : count].reshape(m, 3),
    )
    return _with_coordinates(joined, J @ P @ J.T)


def _with_coordinates(solution: ViewsSolution, covariance: FloatArray) -> ViewsSolution:
    """A solution of two views whose coordinates are the motions and normals themselves."""
    m, every = len(solution.scaled_normals), np.eye(len(covariance))
    return replace(
        solution,
        motion_covariance=covariance,
        basis=every[: PART["reference"].stop],
        normal_gain=every[PART["reference"].stop :].reshape(m, 3, -1),
        own_covariance=np.zeros((m, 3, 3)),
        alternative=None,
    )
