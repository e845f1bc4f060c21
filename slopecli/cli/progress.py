"""How far a batch is, on stderr: one line that is written over on a terminal, a few lines in a log."""

from __future__ import annotations

import os
import shutil
import sys
import time
from typing import TYPE_CHECKING

from slopecli.cli.talk import Talk, tell

if TYPE_CHECKING:
    from slopecli.batch.jobs import Outcome, Progress

REDRAW_S = 0.1  # on a terminal
LOG_S, TENTH_S = 30.0, 2.0  # in a log: the longest silence, and the shortest from one tenth of the pairs to the next
ERASE_LINE = "\r\x1b[K"


class ProgressLine:
    """Says after every pair what is worth saying: rate, time left, and each pair that has no answer."""

    def __init__(self, talk: Talk) -> None:
        self._talk = talk
        listens = sys.stderr is not None and sys.stderr.isatty()  # None: closed, as by 2>&-
        self._live = listens and os.environ.get("TERM") != "dumb" and not talk.quiet
        self._start = self._last = time.monotonic()
        self._tenths = 0
        self._latest: Progress | None = None

    def __call__(self, progress: Progress) -> None:
        if progress.latest.exit_status:
            self.say(f"warning: {failure_line(progress.latest)}")
        elif self._talk.verbose:
            self.say(f"{progress.latest.name}: answered")
        self._latest, now = progress, time.monotonic()
        tenths = 10 * progress.n_done // progress.n_pairs
        if self._live and now - self._last >= REDRAW_S:
            # a line that wraps cannot be erased
            shown = self._line(progress, now)[: shutil.get_terminal_size().columns - 1]
            tell(f"{ERASE_LINE}{shown}", end_line=False)
            self._last = now
        elif not self._live and now - self._last >= (TENTH_S if tenths > self._tenths else LOG_S):
            self._talk.say(self._line(progress, now))
            self._last, self._tenths = now, tenths

    def say(self, line: str) -> None:
        """Say a line of its own, with nothing of the progress left in it."""
        self.erase()
        self._talk.say(line)

    def erase(self) -> None:
        """Take the line off the terminal."""
        if self._live:
            tell(ERASE_LINE, end_line=False)

    @property
    def so_far(self) -> str:
        """How many pairs are done."""
        return "no pair" if self._latest is None else f"{self._latest.n_done} of {self._latest.n_pairs} pairs"

    def _line(self, progress: Progress, now: float) -> str:
        parts = [f"{progress.n_done} of {progress.n_pairs} pairs"]
        if progress.n_kept:
            parts.append(f"{progress.n_kept} kept from before")
        parts.append(f"{progress.n_failed} without an answer")
        answered, seconds = progress.n_done - progress.n_kept, now - self._start
        if answered and seconds > 0:
            rate = answered / seconds
            left = (progress.n_pairs - progress.n_done) / rate
            parts += [_rate(rate), f"{_duration(left)} left" if progress.n_done < progress.n_pairs else "done"]
        return ", ".join(parts)


def failure_line(outcome: Outcome) -> str:
    """The pair without an answer, the reason and the remedy, in one line."""
    reason = "; ".join(part for part in (outcome.message, outcome.remedy) if part)
    return " ".join(": ".join(part for part in (outcome.name, outcome.code, reason) if part).split())


def _rate(pairs_per_second: float) -> str:
    if pairs_per_second >= 1:
        return f"{pairs_per_second:.1f} pairs/s"
    return f"{60 * pairs_per_second:.1f} pairs/min"


def _duration(seconds: float) -> str:
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
