"""A slope map on the terminal: its landing sites as a table, and in a line what the ground is like."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from slopecli.cli.report_table import say_notes
from slopecli.cli.table import Table, print_table
from slopecli.cli.talk import Talk, check_stdout, print_result
from slopecli.report.slope_units import SlopeUnit, slope_unit_of

if TYPE_CHECKING:
    from pathlib import Path

    from slopecli.ground.slope_map import Site, SlopeMap

HEADER = ("site", "centre (px)", "in image 2 (px)", "radius", "slope", "above", "below", "P(safe)")


def print_map(answer: SlopeMap, written: list[Path], talk: Talk, *, as_json: bool) -> None:
    """Print the landing sites on stdout, as a table or as JSON; notes and the files written on stderr."""
    if not written:
        check_stdout()
    if as_json:
        from slopecli.products.slopes_json import map_to_json

        print_result(map_to_json(answer))
    else:
        print_sites(answer, talk)
    say_ground(answer, talk)
    say_notes(answer.report, written, talk)


def print_sites(answer: SlopeMap, talk: Talk) -> None:
    """Print the landing sites on stdout."""
    if answer.sites:
        print_table(sites_table(answer), talk)
    else:
        print_result("no landing site")


def say_ground(answer: SlopeMap, talk: Talk) -> None:
    """Say what the ground is like, and why there is no landing site where there is none."""
    talk.say(ground_line(answer))
    if answer.no_site:
        talk.say(f"no landing site: {answer.no_site}")


def say_lengths(answer: SlopeMap, given: Mapping[str, Any], talk: Talk) -> None:
    """Say what lengths of the command line count in, if there is no scale. given : parameters by name."""
    named = [f"--{name.replace('_', '-')}" for name in ("lander", "max_height") if given.get(name) is not None]
    if named and answer.report.scale.unit != "m":
        talk.say(
            f"info: {' and '.join(named)} count in baselines, distances between the two cameras, as there is no scale; "
            "give --baseline, --altitude or --pose for metres"
        )


def sites_table(answer: SlopeMap) -> Table:
    """A row for each landing site, best first; lengths in metres where the scale is known."""
    with_lander = any(site.lander_slope_deg is not None for site in answer.sites)
    header = (*HEADER, "lander") if with_lander else HEADER
    unit = slope_unit_of(answer.report.options)
    metres = " m" if answer.report.scale.unit == "m" else " b"
    return Table(header, [_cells(site, metres, unit)[: len(header)] for site in answer.sites])


def _cells(site: Site, metres: str, unit: SlopeUnit) -> tuple[str, ...]:
    def length(value: float) -> str:
        return f"{value:.3g}{metres}"

    in_image2 = "-" if site.centre_image2_px is None else "{:.1f}, {:.1f}".format(*site.centre_image2_px)
    lander = "-"
    if site.lander_slope_deg is not None and site.lander_clearance is not None:
        tilt = site.lander_slope_deg
        lander = f"{unit.text(tilt) if unit.has(tilt) else f'{tilt:.1f}°'}, {length(site.lander_clearance)}"
    return (
        str(site.id),
        "{:.1f}, {:.1f}".format(*site.centre_px),
        in_image2,
        f"{site.radius_px:.0f} px = {length(site.radius)}",
        unit.text(site.slope_deg, site.slope_sigma_deg),
        length(site.above_plane_max),
        length(site.below_plane_max),
        f"{site.p_safe:.3f}",
        lander,
    )


def ground_line(answer: SlopeMap) -> str:
    """Shares of the map by verdict, and the size of a footprint."""
    told = ", ".join(f"{100.0 * share:.1f} % {name}" for name, share in answer.area_share.items())
    size = f" = {answer.footprint:.3g} m" if answer.report.scale.unit == "m" else ""
    unit = "" if answer.report.scale.unit == "m" else "; lengths are in baselines (b)"
    return f"ground: {told}; slopes of discs of {answer.footprint_px:.4g} px{size}{unit}"
