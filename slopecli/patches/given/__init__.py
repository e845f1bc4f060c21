"""Correspondences given by the user, as patches."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "rows": "Given",
    },
)
