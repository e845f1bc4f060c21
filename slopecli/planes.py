"""The former name of `slopecli.patches`, kept importable: the plane finders and `label_planes`."""

from __future__ import annotations

from typing import Any


def __getattr__(name: str) -> Any:
    if name in ("PLANE_FINDERS", "label_planes"):
        from slopecli import patches

        return getattr(patches, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
