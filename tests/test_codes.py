"""Every code that is raised has its row and every row is raised; docs/diagnostics.md and the schema follow the rows."""

from __future__ import annotations

import ast
import runpy
from functools import cache
from pathlib import Path

import pytest

from slopecli.findings import CODES, LIMITS, finding, parallax, plane_checks, solution_checks
from slopecli.io import load_schema
from slopecli.look import changes

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "diagnostics.md").read_text(encoding="utf-8")
NAMED = {"NON_PLANAR": plane_checks.NON_PLANAR}  # constants that stand for a code


def rows(*severities: str) -> set[str]:
    return {row.code for row in CODES if row.severity in severities}


@cache
def calls() -> list[tuple[str, ast.Call]]:
    """Every call in the package, with the name of what is called."""
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in sorted((ROOT / "slopecli").rglob("*.py"))]
    nodes = [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return [(getattr(node.func, "id", getattr(node.func, "attr", "")), node) for node in nodes]


def literal(node: ast.expr) -> str | None:
    return node.value if isinstance(node, ast.Constant) else NAMED.get(ast.unparse(node))  # type: ignore[return-value]


def codes_given(name: str, place: int = 0) -> set[str]:
    """The codes that calls of this name are given, at this place among their arguments."""
    given = [literal(call.args[place]) for called, call in calls() if called == name and len(call.args) > place]
    return {code for code in given if code is not None}


def test_every_code_and_severity_has_one_row() -> None:
    assert len({(row.code, row.severity) for row in CODES}) == len(CODES)


def test_diagnostics_are_made_from_rows_only() -> None:
    assert [ast.unparse(call) for name, call in calls() if name == "Diagnostic"] == [
        "Diagnostic(code, found, message, value, remedy or rows[0].remedy or None)"
    ]


def test_every_diagnostic_has_a_row_and_every_row_is_used() -> None:
    found = {
        (literal(call.args[0]), next((literal(word.value) for word in call.keywords if word.arg == "severity"), None))
        for called, call in calls()
        if called == "finding"
    }
    diagnostics = [row for row in CODES if row.severity in ("warning", "info")]
    codes = [row.code for row in diagnostics]
    # of a code with one severity it need not be named
    assert found == {(row.code, row.severity if codes.count(row.code) > 1 else None) for row in diagnostics}


def test_every_refusal_has_a_row_and_every_row_is_used() -> None:
    assert codes_given("NoAnswer") | codes_given("Cause") == rows("refusal")


def test_every_reason_of_a_rejected_patch_has_a_row_and_every_row_is_used() -> None:
    # the reasons of windows are returned beside their words
    assert codes_given("unmatched", 1) | codes_given("Cause") | {"poor-fit", "no-overlap"} == rows("rejection")


def test_a_code_without_a_row_or_of_two_severities_is_no_finding() -> None:
    for code in ("weak-texture", "pure-rotation", "low-parallax"):
        with pytest.raises(ValueError, match=f"rows of CODES have the code '{code}'"):
            finding(code, "message")


def test_severity_and_remedy_are_those_of_the_row_unless_a_better_remedy_is_given() -> None:
    found = finding("low-parallax", "too little", 2.0, severity="info")
    (row,) = (row for row in CODES if (row.code, row.severity) == ("low-parallax", "info"))
    assert (found.severity, found.remedy) == ("info", row.remedy)
    assert finding("upside-down", "it hangs", remedy="turn it").remedy == "turn it"
    assert finding("unexplained", "much").remedy is None


def test_severities_are_those_of_the_schema() -> None:
    allowed = load_schema()["$defs"]["diagnostic"]["properties"]["severity"]["enum"]
    assert rows("warning", "info", "refusal", "rejection") == {row.code for row in CODES}
    assert {row.severity for row in CODES} - {"refusal", "rejection"} <= set(allowed)


def test_diagnostics_page_is_made_from_the_rows() -> None:
    generate = runpy.run_path(str(ROOT / "docs" / "generate.py"))
    for table in (generate["codes_table"](), generate["rejections_table"]()):
        assert f"\n\n{table}\n" in f"{PAGE}\n", "docs/diagnostics.md is not what CODES say: run `make docs`"


def test_rows_have_the_numbers_of_the_code() -> None:
    for said in (
        f"Below {LIMITS['low-parallax']:.0f} px",
        f"motion within {solution_checks.ALONG_DEG:.0f}°, slopes alike to {solution_checks.FLAT_DEG:.0f}°",
        f"at least {100 * changes.LEAST_AREA:.0f} %",
        f"{100 * LIMITS['dense-shadow-or-motion']:.0f} % of the matches contradict",
        f"by more than {LIMITS['poor-fit']:g} px",
    ):
        assert said in PAGE
    assert pytest.approx(0.25) == parallax.MOST_APART  # "a quarter of the distance"
