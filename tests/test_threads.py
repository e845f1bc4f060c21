"""OpenCV's threads are the caller's: what is done on one thread gives them back."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import pytest

from slopecli.look import single_threaded


@pytest.fixture(autouse=True)
def threads_as_before() -> Iterator[None]:
    before = cv2.getNumThreads()
    yield
    cv2.setNumThreads(before)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_as_many_threads_afterwards_as_before(threads: int) -> None:
    cv2.setNumThreads(threads)
    with single_threaded():
        assert cv2.getNumThreads() == 1
    assert cv2.getNumThreads() == threads


def test_also_when_what_was_done_fails() -> None:
    cv2.setNumThreads(2)
    with pytest.raises(KeyError), single_threaded():
        raise KeyError
    assert cv2.getNumThreads() == 2


def test_whoever_leaves_last_gives_them_back() -> None:
    cv2.setNumThreads(2)
    first, second = single_threaded(), single_threaded()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert cv2.getNumThreads() == 1
    second.__exit__(None, None, None)
    assert cv2.getNumThreads() == 2
