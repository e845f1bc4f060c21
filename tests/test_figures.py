"""The figures of a simulation study can be read, however much or little the study holds."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from slopecli.study import StudyOptions, alignment_spread, camera_of, draw_figures, run_study

DRAWN = ("figure4_motion", "figure5_slopes")


def drawn(options: StudyOptions) -> dict[str, bytes]:
    return draw_figures(run_study(options), alignment_spread(options, camera_of(options)))


@pytest.mark.parametrize(
    "solvers",
    [("mle", "ha", "lh"), *(pytest.param(fewer, marks=pytest.mark.slow) for fewer in (("mle",), ("mle", "ha")))],
)
@pytest.mark.parametrize(
    "trajectories",
    [(45.0,), *(pytest.param(more, marks=pytest.mark.slow) for more in ((0.0, 45.0), (0.0, 45.0, 90.0)))],
)
def test_nothing_is_cut_off_at_the_sides(trajectories: tuple[float, ...], solvers: tuple[str, ...]) -> None:
    figures = drawn(StudyOptions(trajectories, (0.3, 1.0), 1, solvers=solvers))
    for name in DRAWN:
        grey = np.array(Image.open(BytesIO(figures[f"{name}.png"])).convert("L"))
        assert grey[:, [0, 1, -2, -1]].min() > 250, name


def test_without_noise_a_figure_says_why_it_is_empty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("slopecli.products.drawing.plots.LETTERING", {"svg.fonttype": "none"})  # letters as letters
    figures = drawn(StudyOptions((45.0,), (0.0,), 1))
    for name in DRAWN:
        svg = figures[f"{name}.svg"].decode()
        assert "no noise" in svg
        assert "Cramér" not in svg  # a legend of nothing


@pytest.mark.slow
def test_one_noise_shows_the_bound_too() -> None:
    """A line through one point is nothing."""
    options = StudyOptions((45.0,), (0.3,), 1, solvers=("ha",))
    grey = np.array(Image.open(BytesIO(drawn(options)["figure4_motion.png"])).convert("L"))
    runs = [len(run) for row in grey < 60 for run in "".join("#" if dark else " " for dark in row).split()]
    assert any(30 <= run <= 50 for run in runs)
