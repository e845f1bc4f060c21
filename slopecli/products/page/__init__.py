"""report.html: one page with the answer, its pictures, its reasons and its model, that opens without a network."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "model_viewer": "viewer_of_report viewer_of_map",
        "page_pictures": "seen_from_1 map_seen_from_1",
        "page_texts": "cheapest_remedy verdict_of verdict_of_map",
        "report_page": "encode encode_map",
    },
)
