"""The table on stdout and the talk on stderr, from reports made by hand."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from typing import Any

import pytest
from report_factory import make_ambiguity, make_region_report, make_report, with_level_plane
from rich.console import Console

from slopecli.cli import Table, Talk, draw_table, print_facts, result_table, talk_lines
from slopecli.report import SLOPE_UNITS
from slopecli.types import Rejected, Scale, Up


def rows_of(table: Table) -> list[str]:
    return list(table.lines())[1:]


def drawn(table: Table, width: int = 120, **console: Any) -> str:
    """A table as a terminal of that width shows it."""
    screen = io.StringIO()
    draw_table(table, ["a line below"], Console(file=screen, force_terminal=True, width=width, **console))
    return screen.getvalue()


def test_windows_come_in_the_order_of_ids_with_those_refused_among_them() -> None:
    report = make_report()
    refused = replace(report.rejected[0], id=0)
    rows = rows_of(result_table(replace(report, rejected=(refused,), planes=report.planes[::-1])))
    assert [int(row.split()[0]) for row in rows] == list(range(9))
    assert rows[0].endswith("no answer: low-texture")


def test_columns_line_up() -> None:
    lines = list(result_table(make_report()).lines())
    assert len({line.index("°") for line in lines[1:9]}) == 1
    assert len({line.index(word) for line in lines[1:9] for word in ("safe", "undecided") if f" {word}" in line}) <= 2
    assert all(line == line.rstrip() for line in lines)


def test_a_line_has_slope_interval_aspect_verdict_and_support() -> None:
    (row, *_) = rows_of(result_table(make_report()))
    assert re.split(r"\s{2,}", row.strip()) == [
        "1", "4.00 ± 0.30°", "3.41 to 4.59°", "0°", "safe", "1.000", "0.0040", "131/140",
    ]  # fmt: skip


def test_what_is_unknown_is_a_dash() -> None:
    report = make_report()
    unknown = replace(report.planes[0], aspect_deg=None, slope_sigma_deg=float("nan"))
    (row, *_) = rows_of(result_table(replace(report, planes=(unknown, *report.planes[1:]))))
    assert "4.00 ± -°" in row
    assert "nan" not in row


def test_a_slope_known_too_badly_is_not_printed() -> None:
    report = make_report()
    vague = replace(
        report.planes[1], slope_sigma_deg=24.2, slope_known=False, status="poor",
        reason="sigma 24° is above --max-sigma 10°", verdict="undecided",
    )  # fmt: skip
    row = rows_of(result_table(replace(report, planes=(report.planes[0], vague))))[1]
    cells = re.split(r"\s{2,}", row.strip())
    assert cells[:5] == ["2", "unknown (± 24°)", "-", "-", "undecided"]
    assert cells[-1] == "poor: sigma 24° is above --max-sigma 10°"
    assert "12.0" not in row


@pytest.mark.parametrize(("sigma_deg", "shown"), [(0.17, "0.17"), (1.26, "1.3"), (0.004, "0.004"), (10.4, "10")])
def test_how_little_is_known_is_told_in_figures(sigma_deg: float, shown: str) -> None:
    report = make_report()
    vague = replace(report.planes[0], slope_sigma_deg=sigma_deg, slope_known=False)
    assert f"  unknown (± {shown}°)  " in rows_of(result_table(replace(report, planes=(vague,))))[0]


@pytest.mark.parametrize(("sigma_deg", "shown"), [(0.0, "0.00"), (0.0049, "<0.01"), (1e-9, "<0.01"), (0.0051, "0.01")])
def test_no_sigma_but_none_is_zero(sigma_deg: float, shown: str) -> None:
    report = make_report()
    sure = replace(report.planes[0], slope_sigma_deg=sigma_deg)
    assert f"  4.00 ± {shown}°  " in rows_of(result_table(replace(report, planes=(sure,))))[0]


def test_a_poor_plane_says_why() -> None:
    report = make_report()
    poor = replace(report.planes[0], status="poor", reason="non-planar-patch")
    (row, *_) = rows_of(result_table(replace(report, planes=(poor,))))
    assert row.endswith("poor: non-planar-patch")


def test_the_plane_taken_as_level_is_called_so_and_has_no_verdict() -> None:
    report = with_level_plane(make_report())
    row, poor_row = (
        rows_of(result_table(replace(report, planes=(plane, *report.planes[1:]))))[0]
        for plane in (report.planes[0], replace(report.planes[0], status="poor", reason="taken-as-level; scattered"))
    )
    cells = ["1", "0.00°", "-", "-", "-", "-", "0.0040", "131/140"]
    assert re.split(r"\s{2,}", row.strip()) == [*cells, "taken as level"]
    assert re.split(r"\s{2,}", poor_row.strip()) == [*cells, "taken as level; poor: scattered"]


def test_an_unresolved_plane_has_both_slopes() -> None:
    report = make_report()
    doubtful = replace(report, ambiguity=make_ambiguity(report))
    others = doubtful.ambiguity.alternative.planes
    for row, plane, other in zip(rows_of(result_table(doubtful)), doubtful.planes, others, strict=False):
        assert f"  {plane.slope_deg:.2f} ± {plane.slope_sigma_deg:.2f}° or {other.slope_deg:.2f} ± 0.70°  " in row
    resolved = replace(doubtful, ambiguity=replace(doubtful.ambiguity, status="resolved"))
    assert not any(" or " in row for row in rows_of(result_table(resolved)))


def test_roughness_has_its_unit_once_there_is_a_scale() -> None:
    metric = make_report(scale=Scale("m", "altitude"))
    assert any("0.0040 m" in row for row in rows_of(result_table(metric)))
    assert not any("0.0040 m" in row for row in rows_of(result_table(make_report())))


def test_a_terminal_shows_verdicts_in_colours() -> None:
    table = result_table(make_report())
    codes = dict(re.findall(r"\x1b\[(\d+)m(safe|unsafe|undecided)", drawn(table)))
    assert sorted(codes.values()) == ["safe", "undecided", "unsafe"]
    assert "\x1b" not in drawn(table, no_color=True) + "".join(table.lines())


@pytest.mark.parametrize("width", [20, 80, 200])
def test_a_terminal_of_any_width_shows_every_cell_and_wraps_the_note_alone(width: int) -> None:
    note = "poor: [red] and /a/path/without/spaces " + "and more " * 9
    table = Table(("id", "slope", "note"), [("1", "30.77 ± 0.06°", ""), ("2", "unknown (± 24°)", note)])
    lines = drawn(table, width, no_color=True).splitlines()
    assert lines[1].rstrip() == " 1    30.77 ± 0.06°"
    words = " ".join(line[len(" 2  unknown (± 24°)  ") :] for line in lines[2:-1])
    assert re.sub(r"\s", "", words) == re.sub(r"\s", "", note)
    assert lines[-1] == "a line below"
    assert max(map(len, lines)) <= max(width, 41)


def test_tables_are_as_wide_as_a_terminal_of_80_columns_and_say_what_they_leave_out() -> None:
    report = make_report()
    vague = {"verdict": "undecided", "reason": "sigma 30 is above --max-sigma", "status": "poor"}
    for planes in (report.planes, tuple(replace(one, **vague) for one in report.planes)):
        screen = io.StringIO()
        gone = draw_table(result_table(replace(report, planes=planes)), [], Console(file=screen, width=80))
        lines = screen.getvalue().splitlines()
        assert max(map(len, lines)) <= 80
        shown = lines[0]
        assert not [title for title in gone if title in shown]
        assert all(title in shown or title in gone for title in ("id", "slope", "verdict", "P(safe)", "points"))
    wide = drawn(result_table(report), 200, no_color=True)
    assert "points" in wide


def test_a_column_without_a_word_goes_first_from_a_narrow_terminal() -> None:
    table = Table(("id", "points", "note"), [("1", "599/603", ""), ("2", "1/2", "")])
    assert drawn(table, 12, no_color=True).splitlines()[:2] == ["id   points", " 1  599/603"]


def test_lines_of_a_terminal_break_between_words_and_those_of_a_pipe_do_not(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    line = "wrote " + ", ".join(f"folder/file_{k}.json" for k in range(9))
    monkeypatch.setenv("COLUMNS", "60")
    Talk().say(line)
    assert capsys.readouterr().err == f"{line}\n"
    screen = io.StringIO()
    monkeypatch.setattr(screen, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("sys.stderr", screen)
    Talk().say(line)
    shown = screen.getvalue().splitlines()
    assert max(map(len, shown)) <= 60
    assert " ".join(part.strip() for part in shown) == line


@pytest.mark.parametrize(
    ("up", "said"),
    [
        (Up((0.0, 0.0, -1.0), "camera"), "camera 1 taken to look straight down"),
        (Up((0.0, 1.0, 0.0), "given", 0.5), "(0.0000, 1.0000, 0.0000) ± 0.5° in camera-1 axes (given)"),
        (Up((0.0, 0.0, -1.0), "dominant-plane"), "the largest plane taken as level"),
    ],
)
def test_talk_says_what_is_level(up: Up, said: str) -> None:
    assert said in next(iter(talk_lines(make_report(up=up))))


def test_talk_names_refusals_and_diagnostics_with_their_remedy() -> None:
    talk = "\n".join(talk_lines(make_report()))
    assert "window 9: no answer: low-texture: 12 correspondences; 20 are needed" in talk
    assert "warning: low-parallax: median parallax 3.1 px; take a longer baseline" in talk


def test_talk_warns_of_a_second_answer_only_if_there_is_one() -> None:
    report = make_report()
    assert not any("second motion" in line for line in talk_lines(report))
    (warning,) = (line for line in talk_lines(make_report(ambiguity=make_ambiguity(report))) if "second motion" in line)
    assert warning.endswith("resolve it with a third image, or a known altitude")
    assert "chi-square larger by 1.3, of 1170 matches" in warning
    assert "P(safe) is the smaller of the two; interval and aspect are the first answer's" in warning


def test_a_second_answer_that_is_ruled_out_is_said_with_its_margin_and_whose_that_is() -> None:
    report = make_report()
    resolved = replace(make_ambiguity(report), status="resolved", delta_chi2=412.0)
    (line,) = (line for line in talk_lines(replace(report, ambiguity=resolved)) if "second motion" in line)
    assert line == (
        "info: a second motion is ruled out (chi-square larger by 412, of 1170 matches); slopes.json has it"
    )
    known = replace(resolved, delta_chi2=91.2, delta_chi2_prior=68.6)
    (line,) = (line for line in talk_lines(replace(report, ambiguity=known)) if "second motion" in line)
    assert "(chi-square larger by 91.2, 22.6 by the images and 68.6 by the motion given, of 1170 matches)" in line


# ---- planes found in the image ----

REGIONS = make_region_report()


def test_planes_found_have_a_kind_and_a_share_of_the_image() -> None:
    header, *rows = result_table(REGIONS).lines()
    assert header.split()[:4] == ["id", "what", "image", "slope"]
    for row, plane in zip(rows, REGIONS.planes, strict=True):
        cells = re.split(r"\s{2,}", row.strip())
        share = 100 * (REGIONS.labels == plane.id).mean()
        assert cells[:4] == [str(plane.id), cells[1], f"{share:.1f} %", f"{plane.slope_deg:.2f} ± "
                             f"{plane.slope_sigma_deg:.2f}°"]  # fmt: skip
        assert cells[1] in ("ground", "wall", "roof")
        assert plane.verdict in cells


def test_a_second_slope_known_too_badly_is_not_printed_either() -> None:
    report = make_report()
    found = make_ambiguity(report)
    vague = tuple(replace(plane, slope_sigma_deg=24.0, slope_known=False) for plane in found.alternative.planes)
    found = replace(found, alternative=replace(found.alternative, planes=vague))
    (row, *_) = rows_of(result_table(replace(report, ambiguity=found)))
    assert "4.00 ± 0.30° or unknown (± 24°)  " in row


def test_what_cannot_be_told_ground_from_roof_is_a_dash() -> None:
    pitched = replace(REGIONS.planes[0], slope_deg=40.0)
    (row,) = rows_of(result_table(replace(REGIONS, planes=(pitched,))))
    assert row.split()[:2] == ["1", "-"]


@pytest.mark.parametrize(("source", "noun"), [("region", "region"), ("ransac", "plane")])
def test_planes_found_and_refused_are_not_called_windows(source: str, noun: str) -> None:
    refused = Rejected(6, REGIONS.planes[0].polygon_px, "low-texture", "no texture in it")
    planes = tuple(replace(plane, source=source, noun=noun) for plane in REGIONS.planes)
    report = replace(REGIONS, planes=planes, rejected=(refused,), ambiguity=make_ambiguity(REGIONS))
    assert rows_of(result_table(report))[-1].split()[:3] == ["6", "-", "-"]
    talk = "\n".join(talk_lines(report))
    assert f"{noun} 6: no answer: low-texture: no texture in it" in talk
    assert f"no {noun} is called safe" in talk
    assert "window" not in talk


def test_talk_warns_that_the_largest_plane_may_be_a_wall() -> None:
    up = Up((0.0, 0.0, -1.0), "dominant-plane")
    assert "if it is a wall, give --up X,Y,Z" in next(iter(talk_lines(replace(REGIONS, up=up))))


@pytest.mark.parametrize(
    ("name", "slope", "interval"),
    [
        ("deg", "15.00 ± 0.50°", "14.00 to 16.00°"),
        ("percent", "26.8 ± 0.9 %", "24.9 to 28.7 %"),
        ("x-in-12", "3.22 ± 0.11 in 12", "2.99 to 3.44 in 12"),
    ],
)
def test_slopes_in_the_units_of_a_road_and_of_a_roof(name: str, slope: str, interval: str) -> None:
    """A rise over a run of 100 and of 12: tan 15 deg = 0.268, whose derivative is 1 / cos(15 deg)^2."""
    unit = SLOPE_UNITS[name]
    assert unit.text(15.0, 0.5) == slope
    assert unit.interval(14.0, 16.0) == interval


def test_walls_are_in_degrees_in_any_unit() -> None:
    for unit in SLOPE_UNITS.values():
        assert unit.text(89.0, 0.2) == "89.00 ± 0.20°"
        assert unit.interval(70.0, 95.0) == "70.00 to 95.00°"


def test_a_small_sigma_is_not_rounded_to_certainty() -> None:
    assert [unit.text(10.0, 0.001) for unit in SLOPE_UNITS.values()] == [
        "10.00 ± <0.01°",
        "17.6 ± <0.1 %",
        "2.12 ± <0.01 in 12",
    ]


def test_facts_go_on_below_what_is_said_of_them_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    line = "distortion  " + "; ".join(f"corner {k} 21.61 px" for k in range(6))
    monkeypatch.setenv("COLUMNS", "60")
    print_facts([line], indent=12)
    assert capsys.readouterr().out == f"{line}\n"
    screen = io.StringIO()
    monkeypatch.setattr(screen, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("sys.stdout", screen)
    print_facts([line], indent=12)
    shown = screen.getvalue().splitlines()
    assert max(map(len, shown)) <= 60
    assert all(row.startswith(12 * " ") for row in shown[1:])
    assert " ".join(screen.getvalue().split()) == " ".join(line.split())
