"""Loaded before any test module, and so before numpy and OpenCV, which read these variables once.

The tests themselves are what runs in parallel (`make test`); a pool of threads in each of them would only be in the way
of the others. The program declines those of OpenBLAS in any case. Tests in which the number of threads matters set it.
"""

from __future__ import annotations

import os

import campaign
import pytest

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
    os.environ.setdefault(name, "1")

# files that take longest, the longest first: begun last, they would leave the other processes idle
LONGEST = [
    "coverage",
    "plane_sets",
    "batch_faults",
    "data_sets",
    "batch_cluster",
    "honesty",
    "batch_running",
    "batch_cli",
    "batch_answer",
    "sample_data",
    "pipeline",
    "regions",
    "study",
    "figures",
    "simulate_cli",
    "segment_cli",
    "cli",
    "plan",
    "photometric",
    "docs",
]


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave slow tests to `make test-all`; what takes longest begins first."""
    if campaign.ALL not in os.environ and not config.getoption("markexpr"):
        slow = [item for item in items if item.get_closest_marker("slow")]
        config.hook.pytest_deselected(items=slow)
        items[:] = [item for item in items if item not in set(slow)]
    place = {f"test_{name}": k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.stem, len(LONGEST)))
