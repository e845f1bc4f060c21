"""The solver works on one BLAS thread, whatever the caller's number is, and gives the caller's number back."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from threadpoolctl import ThreadpoolController

from slopecli.geometry import solve_planes
from slopecli.geometry.solver import SharedLimit, one_blas_thread
from slopecli.study import make_scene


@pytest.fixture
def blas() -> Iterator[ThreadpoolController]:
    """NumPy's BLAS on two threads, as in a script of a user; SciPy may have brought another."""
    found = [library["filepath"] for library in ThreadpoolController().info() if "numpy" in library["filepath"]]
    controller = ThreadpoolController().select(user_api="blas").select(filepath=found)
    with controller.limit(limits=2):
        if numbers_of(controller) != {2}:
            pytest.skip("no BLAS library whose threads can be set")
        yield controller


def numbers_of(controller: ThreadpoolController) -> set[int]:
    return {library["num_threads"] for library in controller.info()}


def test_blas_has_one_thread_inside_and_its_own_number_after(blas: ThreadpoolController) -> None:
    with one_blas_thread():
        with one_blas_thread():
            assert numbers_of(blas) == {1}
        assert numbers_of(blas) == {1}
    assert numbers_of(blas) == {2}


def test_solving_gives_the_number_back(blas: ThreadpoolController) -> None:
    scene = make_scene(np.random.default_rng(1))
    solve_planes(scene.x1, scene.x2, scene.patch)
    assert numbers_of(blas) == {2}


def test_a_limit_is_set_by_the_first_and_lifted_by_the_last() -> None:
    log: list[str] = []

    def limit() -> object:
        log.append("set")
        return lambda: log.append("lifted")

    shared = SharedLimit(limit)
    first, second = shared(), shared()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert log == ["set"]
    second.__exit__(None, None, None)
    assert log == ["set", "lifted"]
