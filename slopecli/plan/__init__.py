"""Before a flight: the slope sigmas that two images will give, and the baseline that a wanted sigma needs.

Sigmas are the solver's covariance at the true motion and planes, computed from where points lie, without images. A few
simulated pairs are solved, too: they show whether a second root will be left.
"""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "baseline": "needed_baseline",
        "flight": "Flight Window ground_normals horizontal unseen_tilts",
        "footprint_sigma": "PIXEL_NOISE footprint_of footprint_sigmas",
        "plan_map": "draw_plan sigma_colours",
        "plan_options": "PlanOptions",
        "prediction": "Forecast forecast",
        "result": "Plan PlannedMap PlannedWindow make_plan sigma_text",
    },
)
