"""How far a long command is, on stderr: a bar by rich on a terminal; with -v now and then a line of text in a log."""

from __future__ import annotations

import math
import os
import sys
import time
from typing import TYPE_CHECKING, Self

from slopecli.cli.talk import Talk, is_terminal, stderr_may_be_gone
from slopecli.errors import visible

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

    from slopecli.batch.jobs import Outcome, Progress

SILENCE_S = (2.0, 30.0)  # in a log: the shortest from one tenth to the next, and the longest


class ProgressLine:
    """A line on a terminal that says how far the work is, gone at the end of a `with` block; nothing with -q.

    Where stderr is a file or a pipe it is said with -v alone, at each tenth and after a long silence.
    """

    def __init__(self, talk: Talk) -> None:
        self._talk = talk
        drawable = is_terminal(sys.stderr) and os.environ.get("TERM") != "dumb"
        self._bar = _start_bar() if drawable and not talk.quiet else None
        self._start = self._last = time.monotonic()
        self._tenths = 0

    @property
    def seconds(self) -> float:
        """Seconds since the work began."""
        return time.monotonic() - self._start

    def show(self, done: int, total: int, text: str) -> None:
        """Show that `done` of `total` parts are done, in the words of `text`, unless that was done a moment ago."""
        now, tenths = time.monotonic(), 10 * done // total
        least_s, most_s = SILENCE_S
        if self._bar:
            if now - self._last >= 0.1:  # s
                self._last = now
                with stderr_may_be_gone():
                    self._bar.update(self._bar.task_ids[0], completed=done, total=total, description=text, refresh=True)
        elif self._talk.verbose and now - self._last >= (least_s if tenths > self._tenths else most_s):
            self._last, self._tenths = now, tenths
            self._talk.say(text)

    def say(self, line: str) -> None:
        """Say a line of its own, above the bar."""
        if self._bar:
            with stderr_may_be_gone():
                self._bar.console.print(visible(line), markup=False, soft_wrap=True)
        else:
            self._talk.say(line)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Take the bar off the terminal."""
        if self._bar:
            with stderr_may_be_gone():
                self._bar.stop()


def _start_bar() -> Bar:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    console = Console(stderr=True, highlight=False)
    columns = BarColumn(bar_width=20), TextColumn("{task.description}", markup=False)
    # drawn when told: no thread that could meet a terminal that is gone
    bar = Progress(*columns, console=console, auto_refresh=False, transient=True, redirect_stdout=False)
    bar.add_task("", total=None)
    with stderr_may_be_gone():
        bar.start()
    return bar


class BatchProgress(ProgressLine):
    """Progress of a batch: rate, time left, and a line for each pair that has no answer."""

    _latest: Progress | None = None

    def __call__(self, progress: Progress) -> None:
        self._latest = progress
        if progress.latest.exit_status:
            self.say(f"warning: {failure_line(progress.latest)}")
        elif self._talk.verbose:
            self.say(f"{progress.latest.name}: answered")
        self.show(progress.n_done, progress.n_pairs, batch_line(progress, self.seconds))

    def interrupted(self) -> None:
        """Say how many pairs are done and kept."""
        so_far = f"{self._latest.n_done} of {self._latest.n_pairs} pairs" if self._latest else "no pair"
        self.say(f"{so_far} done and kept; the same command again goes on with the rest")


class StageProgress(ProgressLine):
    """Progress of a stage of a study, with the time left; `what` names its parts."""

    def __init__(self, talk: Talk, what: str) -> None:
        super().__init__(talk)
        self._what = what

    def __call__(self, done: int, total: int) -> None:
        left_s = math.ceil(self.seconds * (total - done) / done)
        self.show(done, total, f"{done} of {total} {self._what}, {left_s} s left")


def batch_line(progress: Progress, seconds: float) -> str:
    """How far a batch is after that many seconds, in one line."""
    parts = [f"{progress.n_done} of {progress.n_pairs} pairs"]
    if progress.n_kept:
        parts.append(f"{progress.n_kept} kept from before")
    parts.append(f"{progress.n_failed} without an answer")
    answered = progress.n_done - progress.n_kept
    if answered and seconds > 0:
        rate = answered / seconds
        left = (progress.n_pairs - progress.n_done) / rate
        speed = f"{rate:.1f} pairs/s" if rate >= 1 else f"{60 * rate:.1f} pairs/min"
        parts += [speed, f"{_duration(left)} left" if progress.n_done < progress.n_pairs else "done"]
    return ", ".join(parts)


def failure_line(outcome: Outcome) -> str:
    """The pair without an answer, the reason and the remedy, in one line."""
    reason = "; ".join(part for part in (outcome.message, outcome.remedy) if part)
    return " ".join(": ".join(part for part in (outcome.name, outcome.code, reason) if part).split())


def _duration(seconds: float) -> str:
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"
