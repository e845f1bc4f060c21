"""How far apart two images were taken, and remedies in lengths: how far to move for more parallax."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Separation:
    """How far apart the images were taken: `share` of the distance to the scene, and metres where they are known."""

    share: float
    length_m: float | None = None

    def sideways(self) -> str:
        """Remedy for a move straight ahead: as far to the side."""
        if self.length_m is not None:
            return f"move {self.length_m:.2g} m sideways as well"
        return f"move sideways as well, by {100 * self.share:.2g} % of the distance: {self._example(1.0)}"

    def farther(self, factor: float) -> str:
        """Remedy for so many times the parallax."""
        if self.length_m is not None:
            return f"move {factor * self.length_m:.2g} m between the images instead of {self.length_m:.2g} m"
        wanted, now = 100 * factor * self.share, 100 * self.share
        return (
            f"move by {wanted:.2g} % of the distance to the scene (now {now:.2g} %) between the images: "
            f"{self._example(factor)}"
        )

    def _example(self, factor: float) -> str:
        return f"{20 * factor * self.share:.2g} m at 20 m height"
