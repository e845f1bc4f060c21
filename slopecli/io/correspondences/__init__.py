"""Read a user's own correspondences: one module a format, one row a format in `MATCH_FORMATS`."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "label_image": "read_label_image",
        "match_formats": "MATCH_FORMATS MatchFormat read_correspondences",
        "match_source": "MatchSource",
    },
)
