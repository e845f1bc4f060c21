"""A grid of more windows than the image can hold is refused before its windows are made."""

from __future__ import annotations

import pytest

from slopecli.errors import InputError
from slopecli.windows import check_windows, grid_windows


@pytest.mark.parametrize("grid", [(10**9, 10**9), (21, 1), (1, 16)])
def test_a_grid_that_does_not_fit_is_refused_at_once(grid: tuple[int, int]) -> None:
    with pytest.raises(InputError, match=r"use at most 20x15$"):
        grid_windows(*grid, 320, 240)


def test_the_finest_grid_named_is_accepted() -> None:
    windows = grid_windows(20, 15, 325, 245)
    assert len(windows) == 300
    check_windows(windows, 325, 245)
