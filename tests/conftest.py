"""Loaded before any test module, and so before numpy and OpenCV, which read these variables once.

The tests themselves are what runs in parallel (`make test`); a pool of threads in each of them would only be in the way
of the others. The program declines those of OpenBLAS in any case. Tests in which the number of threads matters set it.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator

import campaign
import pytest

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
    os.environ.setdefault(name, "1")

# files that take longest, the longest first: begun last, they would leave the other processes idle
LONGEST = [
    "coverage",
    "plane_sets",
    "batch_faults",
    "batch_cli",
    "regions",
    "map",
    "pipeline",
    "data_sets",
    "camera_test",
    "honesty",
    "cli",
    "plan",
    "batch_answer",
    "sequence",
    "fuzz",
    "report_page",
    "batch_cluster",
    "changes",
    "window_matching",
    "outputs",
    "features",
    "known_motion",
    "metadata_use",
    "sequence_cli",
    "simulate_cli",
    "segment_cli",
    "batch_running",
    "plan_cli",
    "docs",
    "slope",
    "foerstner",
    "lens_misfit",
    "study",
    "photometric",
    "figures",
]


def pytest_collection_finish() -> None:
    """Leave what was collected, which lives to the end, out of every garbage collection: each takes half a second."""
    gc.freeze()


@pytest.fixture
def _worker_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Answer the pairs of a batch in this process, where a process of their own is not what is tested."""
    from fuzzing.checks import WorkerHere
    from remembered import remembered

    monkeypatch.setattr("slopecli.batch.running.Worker", WorkerHere)
    monkeypatch.setattr("slopecli.batch.answer.estimate", remembered)


@pytest.fixture(scope="module")
def _solved_once() -> Iterator[None]:
    """Match and solve the same pair only once in a module that tests what is made of the answer."""
    from remembered import solved_once

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("slopecli.pipeline._answer", solved_once)
        yield


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave slow tests to `make test-all`; what takes longest begins first."""
    if campaign.ALL not in os.environ and not config.getoption("markexpr"):
        slow = [item for item in items if item.get_closest_marker("slow")]
        config.hook.pytest_deselected(items=slow)
        items[:] = [item for item in items if item not in set(slow)]
    place = {f"test_{name}": k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: place.get(item.path.stem, len(LONGEST)))
