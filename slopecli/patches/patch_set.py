"""What a finder of planes returns: patches of image 1, each with the matches that speak for its plane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from slopecli.patches.footprint import Footprint
from slopecli.patches.match import WindowMatch
from slopecli.segmentation import Segmentation
from slopecli.types import NOUNS, Source


@dataclass(frozen=True, eq=False)
class Patches:
    """Footprints and their matches, in the order of their ids; `segmentation`: how they were found, for pictures.

    ids : 1, 2, ... where they are None.
    """

    source: Source
    footprints: list[Footprint]
    matches: list[WindowMatch]
    segmentation: Segmentation | None = None
    ids: Sequence[int] | None = None

    def id_of(self, index: int) -> int:
        """What users call a patch."""
        return index + 1 if self.ids is None else self.ids[index]

    @property
    def found(self) -> bool:
        """Whether they were found in the image rather than asked about."""
        return self.source not in ("window", "given")

    @property
    def noun(self) -> str:
        """What messages call one of them."""
        return NOUNS[self.source]
