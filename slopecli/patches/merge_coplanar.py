"""Patches that lie on one plane or face one way, solved as such, and what is said of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from slopecli.geometry.solver.coplanar import Group, merge_coplanar
from slopecli.patches.join import Matched
from slopecli.types import Diagnostic, Solution

MOST_DOUBT_DEG = 5.0  # 1-sigma of the tilt of a patch that may say it lies on the plane of others


def merge_patches(matched: Matched, solution: Solution) -> tuple[Matched, Solution, list[Diagnostic]]:
    """The solution with coplanar and parallel patches solved as one, and a note on every group of them.

    Only patches with matches of their own take part, and of those what nothing speaks against: one that is in much
    doubt agrees with any plane. What doubt there is about a match goes into the covariance here, so the matches
    returned carry only that about their patch's parts without matches, which no other patch tells of.
    """
    chosen = [matched.matches[i] for i in matched.answered]
    own = np.array([match.origin == "own" and not match.reason for match in chosen])
    doubt = np.where(own, [match.doubt_rad for match in chosen], 0.0)
    own &= _tilt_sigma(solution, doubt) < MOST_DOUBT_DEG
    doubt *= own
    merged, groups = merge_coplanar(solution, np.flatnonzero(own), doubt)
    if not groups:
        return matched, solution, []
    sure = {
        i: replace(matched.matches[i], doubt_rad=matched.matches[i].unseen_rad)
        for i, seen in zip(matched.answered, own, strict=True)
        if seen
    }
    matches = [sure.get(i, match) for i, match in enumerate(matched.matches)]
    left = np.array([matches[i].doubt_rad for i in matched.answered])
    before, after = _tilt_sigma(solution, doubt), _tilt_sigma(merged, np.where(own, left, 0.0))
    notes = [_note(group, matched, before, after) for group in groups]
    return replace(matched, patches=replace(matched.patches, matches=matches)), merged, notes


def _tilt_sigma(solution: Solution, doubt: np.ndarray) -> np.ndarray:
    """(m,) 1-sigma of each plane's tilt, deg, the mean over all directions."""
    N = solution.scaled_normals
    length = np.linalg.norm(N, axis=1)
    unit = N / length[:, None]
    along = np.einsum("mi,mij,mj->m", unit, solution.normal_covariance, unit)
    across = np.einsum("mii->m", solution.normal_covariance) - along
    return np.degrees(np.sqrt(np.maximum(across, 0.0) / 2 / length**2 + doubt**2))


def _note(group: Group, matched: Matched, before: np.ndarray, after: np.ndarray) -> Diagnostic:
    members = list(group.members)
    ids = ", ".join(str(matched.patches.id_of(matched.answered[k])) for k in members)
    old, new = float(np.median(before[members])), float(np.median(after[members]))
    what = "lie on one plane" if group.shares == "plane" else "face one way"
    return Diagnostic(
        "coplanar",
        "info",
        f"{ids} {what}, and are solved so (chi-square {group.chi2:.1f} over {group.dof}): 1-sigma of the tilt "
        f"{old:.2g} -> {new:.2g} deg",
        old / max(new, 1e-9),
        "leave out --merge-coplanar to have each by itself",
    )
