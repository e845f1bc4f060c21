"""Read a known motion between two cameras from a JSON file."""

from __future__ import annotations

import json
import math
from os import PathLike
from typing import Any

import numpy as np

from slopecli.errors import InputError
from slopecli.io.cameras.values import first_twice
from slopecli.io.files import read_file
from slopecli.options import Pose
from slopecli.types import FloatArray

ORTHONORMAL = 1e-4  # largest difference of R R^T from the identity: R printed with few digits
LENGTHS_M = (1e-9, 1e12)  # beyond, its square underflows or overflows
POSITIONS = ("T", "baseline_cam1", "t")
WANTED = (
    'needed JSON with "R" (3x3, camera 2 from camera 1) and "T" (where camera 2 is in camera-1 axes, metres), '
    'or "t" = -R T as OpenCV has it'
)


def load_pose(path: str | PathLike[str]) -> Pose:
    """Read {"R": 3x3, "T": [x, y, z]}: P2 = R (P1 - T), T in metres; or "t" = -R T in place of "T", as three numbers or
    a column of three.

    The names in slopes.json, `rotation_cam2_from_cam1` and `baseline_cam1`, are accepted too; other keys are ignored.

    Raises
    ------
    InputError : the file cannot be read, has no motion with a baseline, or values that contradict each other.
    """
    values = _read(path)
    R = _rotation(path, values)
    T = _position(path, values, R)
    return Pose(tuple(map(float, R.ravel())), (float(T[0]), float(T[1]), float(T[2])))


def load_attitude(path: str | PathLike[str]) -> tuple[FloatArray, FloatArray]:
    """Read the attitude R (3, 3) and the place T (3,) of camera 1 among points: P1 = R (P - T); or "t" = -R T.

    The same file as of `load_pose`, but T may be zero, and be in any unit.

    Raises
    ------
    InputError : the file cannot be read, or has no rotation and place.
    """
    values = _read(path)
    R = _rotation(path, values)
    name = next((name for name in POSITIONS if name in values), None)
    if name is None:
        raise InputError(f"{path}: has no {' or '.join(map(repr, POSITIONS))}; {WANTED}")
    place = _numbers(path, values, (name,), (3,))
    return R, -R.T @ place if name == "t" else place


def _rotation(path: str | PathLike[str], values: dict[str, Any]) -> FloatArray:
    """R, orthonormal to the last digit."""
    R = _numbers(path, values, ("R", "rotation_cam2_from_cam1"), (3, 3))
    if np.abs(R).max() > 2 or not np.abs(R @ R.T - np.eye(3)).max() < ORTHONORMAL or np.linalg.det(R) < 0:
        raise InputError(f"{path}: its R is no rotation (R R^T is not 1, or it mirrors); {WANTED}")
    U, _, Vt = np.linalg.svd(R)
    return np.asarray(U @ Vt)


def _position(path: str | PathLike[str], values: dict[str, Any], R: FloatArray) -> FloatArray:
    """T from all keys that are given, in either convention; they must agree."""
    found = [(name, _numbers(path, values, (name,), (3,))) for name in POSITIONS if name in values]
    if not found:
        raise InputError(f"{path}: has no {' or '.join(map(repr, POSITIONS))}; {WANTED}")
    for _, value in found:
        length = math.hypot(*value)
        if not LENGTHS_M[0] < length < LENGTHS_M[1]:
            what = "is zero, so there is no parallax" if length == 0 else f"is {length:.3g} m long"
            raise InputError(f"{path}: its T {what}; {WANTED}")
    first, *others = (-R.T @ value if name == "t" else value for name, value in found)
    if any(math.dist(first, other) > ORTHONORMAL * math.hypot(*first) for other in others):
        names = " and ".join(repr(name) for name, _ in found)
        raise InputError(f"{path}: {names} contradict each other (t = -R T is not so); leave one out")
    return first


def _read(path: str | PathLike[str]) -> dict[str, Any]:
    try:
        values = json.loads(read_file(path, "pose file", 4_000_000), object_pairs_hook=_once)
    except _Twice as error:
        raise InputError(f"{path}: has {error} twice; leave one out") from None
    except (ValueError, RecursionError):
        raise InputError(f"{path}: is not JSON; {WANTED}") from None
    if not isinstance(values, dict):
        raise InputError(f"{path}: holds no object; {WANTED}")
    motion, scale = values.get("motion"), values.get("scale")
    if not isinstance(motion, dict) or "R" in values:
        return values
    if not isinstance(scale, dict) or scale.get("unit") != "m":
        raise InputError(f"{path}: its motion is in baselines, not metres; {WANTED}")
    return motion


class _Twice(ValueError):
    """A key stands twice in one object."""


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if (twice := first_twice(name for name, _ in pairs)) is not None:
        raise _Twice(repr(twice)[:40])
    return dict(pairs)


def _numbers(path: str | PathLike[str], values: dict[str, Any], names: tuple[str, ...], shape: tuple[int, ...]) -> Any:
    name = next((name for name in names if name in values), None)
    if name is None:
        raise InputError(f"{path}: has no {' or '.join(map(repr, names))}; {WANTED}")
    try:
        found = np.asarray(values[name], float)
    except (TypeError, ValueError, OverflowError):
        found = np.empty(0)
    if found.shape == (3, 1) and shape == (3,):  # as OpenCV's solvePnP and recoverPose return it
        found = found[:, 0]
    if found.shape != shape or not np.isfinite(found).all():
        raise InputError(f"{path}: {name!r} is not {' x '.join(map(str, shape))} finite numbers; {WANTED}")
    return found
