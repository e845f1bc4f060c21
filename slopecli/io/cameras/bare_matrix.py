"""An intrinsic matrix alone: K.txt, K.csv, a .npy, or a list of lists; 3x3, or 4x4 and 3x4 around one."""

from __future__ import annotations

import re
from typing import Any

from slopecli.errors import InputError
from slopecli.io.cameras import values
from slopecli.io.cameras.content import CameraFileContent
from slopecli.types import Camera

NUMBERS = re.compile(r"[\s\[\](),;]*(?:[-+.\d][-+.\deE]*[\s\[\](),;]+)+")


def find(content: CameraFileContent) -> dict[str, list[float]]:
    """The numbers of the matrix, row by row; {} for another format."""
    if content.data.startswith(b"\x93NUMPY"):
        found = _array(content.data)
    elif content.is_binary or len(content.data) > 4000:  # sixteen numbers have a tenth
        return {}
    else:
        found = _numbers(content.text)
    return {"": found} if len(found) in (9, 12, 16) else {}


def _numbers(text: str) -> list[float]:
    lines = [line for line in text.splitlines() if not line.lstrip().startswith(("#", "%"))]
    joined = "\n".join(lines) + "\n"
    if not NUMBERS.fullmatch(joined):
        return []
    return values.numbers(re.split(r"[\s\[\](),;]+", joined.strip(" \t\r\n[](),;")), "a number of the matrix")


def _array(data: bytes) -> list[float]:
    """The numbers of a .npy of at most 16; [] for a larger one, whose header alone is read."""
    from io import BytesIO

    import numpy as np

    file = BytesIO(data)
    try:
        version = np.lib.format.read_magic(file)
        reader = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, kind = reader(file)
        if kind.kind not in "fiu" or len(shape) != 2 or max(shape) > 4:
            return []
        file.seek(0)
        found: list[Any] = np.load(file, allow_pickle=False).astype(float).ravel().tolist()
    except Exception:  # NumPy raises many kinds of exceptions on damaged bytes
        raise InputError("is a damaged NumPy array") from None
    return values.numbers(found, "a number of the matrix")


def read(numbers: list[float], image: values.Size | None) -> Camera:
    """Without distortion, and `Camera.source` says so; skew is kept."""
    columns = 3 if len(numbers) == 9 else 4
    rows = [numbers[k : k + columns] for k in range(0, len(numbers), columns)]
    rest = [*(row[3] for row in rows[:3] if columns == 4), *(rows[3][:3] if len(rows) == 4 else [])]
    if any(rest):
        raise InputError(f"a {len(rows)}x4 matrix with {rest[0]:g}, ... beside K is a projection; give K alone, 3x3")
    fx, fy, cx, cy, skew = values.skewed_intrinsics([row[:3] for row in rows[:3]], "the matrix")
    lens = (0.0,) * 6 + (skew / fx if fx else 0.0,)
    return values.make_camera(
        "matrix, no distortion given", image, (fx, fy, cx, cy), "polynomial", lens, size_given=False
    )
