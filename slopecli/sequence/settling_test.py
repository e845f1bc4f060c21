"""When to stop: the windows whose verdict will stand, by a test that may be repeated after every view.

A verdict that is asked for again and again is wrong more often than its confidence says: each look is another chance.
So the k-th look at one of m windows takes a verdict only if its probability of being wrong is below
(1 - confidence) / (m k (k + 1)). These sum to 1 - confidence over all looks and windows, which bounds the probability
that any verdict was wrong when the run stopped (union bound; the spending of Robbins, 1970).
"""

from __future__ import annotations

from slopecli.findings.wording import forbid_safe
from slopecli.types import Plane, Report, Verdict


class SettlingTest:
    """Windows by id whose verdict is settled, and how."""

    def __init__(self, windows: int, confidence: float) -> None:
        self._windows = windows
        self._wrong = 1.0 - confidence
        self._looks = 0
        self._doubted = False
        self.settled: dict[int, Verdict] = {}

    def look(self, report: Report) -> dict[int, Verdict]:
        """Take in the answer after one more view; the windows settled so far.

        Where a finding forbids to call anything safe, such as one on the camera, no verdict stands.
        """
        self._looks += 1
        self._doubted = forbid_safe(report.diagnostics)
        if self._doubted:
            self.settled = {}
            return self.settled
        allowed = self._wrong / (self._windows * self._looks * (self._looks + 1))
        for plane in report.planes:
            verdict = _beyond(plane, report, allowed)
            if verdict is not None:
                self.settled.setdefault(plane.id, verdict)
        return self.settled

    @property
    def complete(self) -> bool:
        """Whether every window is settled."""
        return not self._doubted and len(self.settled) == self._windows


def _beyond(plane: Plane, report: Report, allowed: float) -> Verdict | None:
    """The verdict if it is wrong with a probability of at most `allowed`, in the second root, too, if one is left."""
    if plane.p_safe is None or plane.verdict not in ("safe", "unsafe"):
        return None
    other = report.ambiguity.others.get(plane.id)
    most = plane.p_safe if other is None or other.p_safe is None else max(plane.p_safe, other.p_safe)
    wrong = 1.0 - plane.p_safe if plane.verdict == "safe" else most
    return plane.verdict if wrong <= allowed else None
