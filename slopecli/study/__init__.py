"""The simulation study of the paper, section 4.1, and its figures."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "claims": "Claim bound_ratios chance_of_ratios jackknifed judge_spread judge_study judge_times mean "
        "time_exponent",
        "figures": "draw_figures",
        "parameters": "StudyOptions",
        "scenes": "Scene UP field_of_view_camera make_scene make_sequence paper_scene project",
        "trials": "QUANTITIES Study Timing alignment_spread camera_of least_errors mean_length measure_times "
        "paper_study run_study study_scene",
    },
)
