"""Tables on stdout: drawn by rich on a terminal, plain aligned text elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from slopecli.cli.talk import is_terminal, print_result
from slopecli.errors import visible

if TYPE_CHECKING:
    from rich.console import Console

WORD_COLUMNS = {"what", "verdict", "note", "pair", "result", "image 1", "image 2", "camera"}
WORD_COLUMNS |= {"held", "claim", "measured", "limit", "source"}
COLOURS = {"safe": "green", "unsafe": "red", "undecided": "yellow"}
COLOURS |= {"answered": "green", "failed": "red", "no answer": "yellow"}


@dataclass(frozen=True)
class Table:
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


def print_table(table: Table, *below: str) -> None:
    """Print a table and lines below it: with colours where a terminal takes them, as plain text in a pipe or a file."""
    table = Table(table.header, [tuple(map(visible, row)) for row in table.rows])
    if is_terminal(sys.stdout):
        from rich.console import Console

        draw_table(table, below, Console(highlight=False))
    else:
        print_result("\n".join([*table.lines(), *below]))


def draw_table(table: Table, below: Sequence[str], console: Console) -> None:
    """Print a table on a terminal: verdicts in colour; long words wrapped inside their column, numbers never.

    rich honours NO_COLOR. On a terminal too narrow even so, lines are longer than it is wide.
    """
    from rich.table import Table as RichTable
    from rich.text import Text

    drawn = RichTable(box=None, pad_edge=False, header_style="", padding=(0, 2, 0, 0))
    narrowest = []
    for title, *cells in zip(table.header, *table.rows, strict=True):
        words, width = title in WORD_COLUMNS, max(map(len, [title, *cells]))
        least = min(width, 20) if words else width
        narrowest.append(least)
        justify: Any = "left" if words else "right"
        drawn.add_column(title, justify=justify, no_wrap=width == least, overflow="fold", min_width=least)
    for row in table.rows:
        drawn.add_row(*(Text(cell, COLOURS.get(cell, "")) for cell in row))
    console.width = max(console.width, sum(narrowest) + 2 * (len(narrowest) - 1))
    console.print(drawn)
    for line in below:
        console.print(Text(line), soft_wrap=True)
