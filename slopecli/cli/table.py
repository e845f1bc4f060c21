"""Tables on stdout: as wide as a terminal, by rich; plain aligned text elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from slopecli.cli.talk import Talk, is_terminal, print_result
from slopecli.errors import visible

if TYPE_CHECKING:
    from rich.console import Console

WORD_COLUMNS = {
    *("what", "verdict", "note", "pair", "result", "image 1", "image 2", "camera"),
    *("held", "claim", "measured", "limit", "source"),
}  # titles of columns of words, which are aligned to the left
COLOURS = {
    "safe": "green",
    "unsafe": "red",
    "undecided": "yellow",
    "answered": "green",
    "failed": "red",
    "no answer": "yellow",
}
# titles of columns that are left out, in this order, until a table is as narrow as the terminal
LEFT_OUT = (
    *("in image 2 (px)", "points", "roughness", "normal off", "distance", "95 % interval", "below", "above"),
    *("refused", "poor", "unknown", "undecided", "sites", "aspect", "image", "source", "limit"),
)


class Table(NamedTuple):
    """A table as text: titles of the columns, and rows with a cell for each."""

    header: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]

    def lines(self) -> Iterator[str]:
        """Lines of plain text: words to the left, numbers to the right, two spaces between columns."""
        widths = [max(map(len, column)) for column in zip(self.header, *self.rows, strict=True)]
        for row in (self.header, *self.rows):
            cells = [
                cell.ljust(width) if title in WORD_COLUMNS else cell.rjust(width)
                for title, cell, width in zip(self.header, row, widths, strict=True)
            ]
            yield "  ".join(cells).rstrip()


def print_table(table: Table, talk: Talk, *below: str) -> None:
    """Print a table and lines below it: with colours where a terminal takes them, as plain text in a pipe or a file.

    On a terminal it is no wider than that, and the columns left out for it are said on stderr.
    """
    talk.clear()
    table = Table(table.header, [tuple(map(visible, row)) for row in table.rows])
    if is_terminal(sys.stdout):
        from rich.console import Console

        console = Console(highlight=False)
        if left_out := draw_table(table, below, console):
            talk.say(f"not shown in {console.width} columns: {', '.join(left_out)}")
    else:
        print_result("\n".join([*table.lines(), *below]))


def draw_table(table: Table, below: Sequence[str], console: Console) -> list[str]:
    """Print a table on a terminal: verdicts in colour; long words wrapped inside their column, numbers never.

    Of a table that is too wide even so, columns are left out (`LEFT_OUT`); returns their titles. rich honours NO_COLOR.
    On a terminal too narrow for the others, lines are longer than it is wide.
    """
    from rich.table import Table as RichTable
    from rich.text import Text

    table, left_out = _narrowed(table, console.width)
    drawn = RichTable(box=None, pad_edge=False, header_style="", padding=(0, 2, 0, 0))
    for title, (least, width) in zip(table.header, _widths(table), strict=True):
        justify: Any = "left" if title in WORD_COLUMNS else "right"
        drawn.add_column(title, justify=justify, no_wrap=width == least, overflow="fold", min_width=least)
    for row in table.rows:
        drawn.add_row(*(Text(cell, COLOURS.get(cell, "")) for cell in row))
    narrow, console.width = console.width, max(console.width, _narrowest(table))
    console.print(drawn)
    for line in below:
        console.print(Text(line), soft_wrap=True)
    console.width = narrow
    return left_out


def _narrowed(table: Table, width: int) -> tuple[Table, list[str]]:
    """A table without the columns for which there is no room, and their titles; empty columns go first."""
    left_out: list[str] = []
    empty = [title for title, *cells in zip(table.header, *table.rows, strict=True) if not any(cells)]
    for title in (title for title in (*empty, *LEFT_OUT) if title in table.header):
        if _narrowest(table) <= width:
            break
        kept = [k for k, one in enumerate(table.header) if one != title]
        header, *rows = (tuple(row[k] for k in kept) for row in (table.header, *table.rows))
        table = Table(header, rows)
        left_out += [title] * (title not in empty)
    return table, left_out


def _narrowest(table: Table) -> int:
    """Characters of a table whose words are wrapped."""
    return sum(least for least, _ in _widths(table)) + 2 * (len(table.header) - 1)


def _widths(table: Table) -> list[tuple[int, int]]:
    """The least width of every column, and that without wrapping."""
    columns = zip(table.header, *table.rows, strict=True)
    widths = [(title, max(map(len, [title, *cells]))) for title, *cells in columns]
    return [(min(width, 16) if title in WORD_COLUMNS else width, width) for title, width in widths]
