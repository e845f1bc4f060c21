"""Arrays of NumPy files that hold as many bytes as they say, so that a short file takes no gigabytes."""

from __future__ import annotations

import io
import math
import zipfile
from typing import Any

import numpy as np
from numpy.typing import NDArray


def array_of(data: bytes) -> NDArray[Any]:
    """The array of a .npy file; pickled objects are not loaded.

    ValueError : it is none, is cut short, or holds objects.
    """
    file = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(file)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, _, dtype = read(file)
        if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(data) - file.tell():
            raise ValueError
        file.seek(0)
        return np.asarray(np.load(file, allow_pickle=False))
    except Exception:  # NumPy raises many kinds of exceptions on damaged bytes
        raise ValueError("no NumPy array of numbers, or cut short") from None


def members_of(data: bytes) -> dict[str, zipfile.ZipInfo]:
    """The arrays of a .npz file by name, not read yet; ValueError : it is none."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return {part.filename.removesuffix(".npy"): part for part in archive.infolist()}
    except Exception:  # zipfile raises many kinds of exceptions on damaged bytes
        raise ValueError("a damaged zip or NumPy archive") from None


def member_of(data: bytes, part: zipfile.ZipInfo, max_bytes: int = 1_000_000_000) -> NDArray[Any]:
    """An array of a .npz file; ValueError : it is none, is damaged, or has more bytes."""
    if part.file_size > max_bytes:
        raise ValueError(f"larger than {max_bytes / 1e6:.0f} MB")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            content = archive.read(part)
    except Exception:
        raise ValueError("a damaged zip or NumPy archive") from None
    return array_of(content)
