"""Verdicts where a diagnostic forbids to call anything safe."""

from __future__ import annotations

from dataclasses import replace

from slopecli.findings.wording import forbid_safe
from slopecli.types import Report


def withhold_safe(report: Report) -> Report:
    """Turn every verdict safe into undecided where a diagnostic forbids it, in the second root too.

    Slopes, sigmas and `p_safe` stay as they are.
    """
    if not forbid_safe(report.diagnostics):
        return report
    planes = tuple(replace(one, verdict="undecided") if one.verdict == "safe" else one for one in report.planes)
    ambiguity = report.ambiguity
    if second := ambiguity.alternative:
        others = tuple(replace(one, verdict="undecided") if one.verdict == "safe" else one for one in second.planes)
        ambiguity = replace(ambiguity, alternative=replace(second, planes=others))
    return replace(report, planes=planes, ambiguity=ambiguity)
