"""Before a flight: how well two images will tell the slopes, and how far apart they must be taken.

What the solver would say of its own answer is computed without images, from where points lie: the same covariance, at
the true motion and planes. A few simulated pairs, solved, say whether geometry would leave two answers.
"""

from slopecli.plan.baseline import needed_baseline
from slopecli.plan.flight import Flight, Window, ground_normals, horizontal
from slopecli.plan.prediction import Forecast, forecast
from slopecli.plan.result import Plan, PlannedWindow, PlanOptions, make_plan, sigma_text

__all__ = [
    "Flight",
    "Forecast",
    "Plan",
    "PlanOptions",
    "PlannedWindow",
    "Window",
    "forecast",
    "ground_normals",
    "horizontal",
    "make_plan",
    "needed_baseline",
    "sigma_text",
]

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "plan_map": "draw_plan sigma_colours",
        "visibility": "unseen_tilts",
    },
)
