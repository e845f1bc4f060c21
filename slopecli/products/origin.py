"""Where an answer comes from, for files that say more than the answer itself."""

from __future__ import annotations

from dataclasses import dataclass

from slopecli.types import Image


@dataclass(frozen=True, eq=False)
class Origin:
    """What a page says besides the answer.

    image2 : image 2, None where there is none at hand.
    command : the command line, "" where it is not known.
    notes : how files were read and what was converted, in sentences.
    """

    image2: Image | None = None
    command: str = ""
    notes: tuple[str, ...] = ()
