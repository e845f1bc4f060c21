"""From a solution to a Report, the mirror of slopes.json."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "build": "build_report",
        "camera_summary": "CameraFacts camera_facts camera_lines",
        "kinds": "main_planes plane_kinds plane_shares",
        "sigma_parts": "CAUSES sigma_causes",
        "slope_units": "SLOPE_UNITS",
        "second_root": "deciding_sigma margin what_decides",
    },
)
