"""Options that stand under headings: `--help` prints one list a heading, in the order in which a command names them."""

from __future__ import annotations

from typing import Any

import click

GENERAL = "General"
NAMES_WIDTH = 27  # characters, so that the lists of a help text line up


class Option(click.Option):
    """An option under a heading of `--help`. Its line there has the default; the range is said when a value is refused.

    Parameters
    ----------
    heading : the list that it stands in.
    names : its flags and, where it differs from them, the name of the parameter, separated by spaces.
    metavar : what stands for its value; None to show the choices of `kind`.
    kind : type of its value.
    help : one plain sentence, without a full stop.
    default : value where it is not given.  shown : what the help calls that, the value itself by default.
    """

    def __init__(
        self,
        heading: str,
        names: str,
        metavar: str | None,
        kind: Any,
        help: str,
        default: Any = None,
        *,
        shown: str | None = None,
        **attributes: Any,
    ) -> None:
        super().__init__(names.split(), metavar=metavar, type=kind, help=help, default=default, **attributes)
        self.heading = heading
        shown = shown or (None if default is None else str(default))
        self.line = help if shown is None else f"{help}  [{shown}]"

    def get_help_record(self, ctx: click.Context) -> tuple[str, str] | None:
        """What stands on the left, and on the right, of its line in the help."""
        record = super().get_help_record(ctx)
        return record and (record[0], self.line)


class Flag(Option):
    """An option without a value."""

    def __init__(self, heading: str, names: str, help: str, **attributes: Any) -> None:
        super().__init__(heading, names, None, None, help, is_flag=True, **attributes)


class Command(click.Command):
    """A command whose `--help` prints options under their headings; what has none stands under "General"."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the lists, those of the options named first first."""
        lists: dict[str, list[tuple[str, str]]] = {}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx) if isinstance(parameter, click.Option) else None
            if record:
                lines = lists.setdefault(getattr(parameter, "heading", GENERAL), [])
                lines.append((record[0].ljust(NAMES_WIDTH), record[1].removesuffix(".")))
        for heading, lines in lists.items():
            with formatter.section(heading):
                formatter.write_dl(lines, col_max=NAMES_WIDTH)
        formatter.write_paragraph()
        formatter.write("Values in [brackets] are defaults.\n")
