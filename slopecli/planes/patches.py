"""What a finder of planes returns: patches of image 1, each with the matches that speak for its plane."""

from __future__ import annotations

from dataclasses import dataclass

from slopecli.planes.footprint import Footprint
from slopecli.planes.window_match import WindowMatch
from slopecli.types import NOUNS, Segmentation, Source


@dataclass(frozen=True, eq=False)
class Patches:
    """Footprints and their matches, in the order of their ids; `segmentation`: how they were found, for pictures."""

    source: Source
    footprints: list[Footprint]
    matches: list[WindowMatch]
    segmentation: Segmentation | None = None

    @property
    def found(self) -> bool:
        """Whether they were found in the image rather than asked about as windows."""
        return self.source != "window"

    @property
    def noun(self) -> str:
        """What messages call one of them."""
        return NOUNS[self.source]
