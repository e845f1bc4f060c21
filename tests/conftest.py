"""Loaded before any test module, and so before numpy and OpenCV, which read these variables once.

The tests themselves are what runs in parallel (`make test`); a pool of threads in each of them would only be in the way
of the others. The program declines those of OpenBLAS in any case. Tests in which the number of threads matters set it.
"""

from __future__ import annotations

import os

import pytest

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
    os.environ.setdefault(name, "1")

# files that take longest, the longest first: were they begun last, one process would be left alone with them
LONG = [
    "data_sets",
    "coverage",
    "batch_faults",
    "sample_data",
    "plane_sets",
    "honesty",
    "study",
    "batch_cluster",
    "solve_noisy",
    "pipeline",
    "regions",
    "batch_answer",
    "batch_running",
    "cli",
    "plan",
    "photometric",
    "batch_cli",
    "simulate_cli",
]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the files; the tests of one stay as they are."""
    place = {f"test_{name}": k for k, name in enumerate(LONG)}
    items.sort(key=lambda item: place.get(item.path.stem, len(LONG)))
