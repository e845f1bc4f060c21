"""Settings of the plots that matplotlib draws: the same for everybody, and the same bytes on every run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

LETTERING = {
    "font.family": "DejaVu Sans",
    "font.size": 13.0,
    "axes.titlesize": 13.0,
    "lines.linewidth": 2.0,
    "lines.markersize": 5.5,
    "svg.hashsalt": "slopemap",
}


@contextmanager
def plot_settings() -> Iterator[None]:
    """Use fixed settings of matplotlib instead of the user's."""
    import logging

    import matplotlib

    logging.getLogger("matplotlib").setLevel(logging.ERROR)  # which says that it looks for fonts, the first time
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(LETTERING)  # type: ignore[arg-type]
        yield
