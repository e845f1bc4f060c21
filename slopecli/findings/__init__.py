"""Checks of images, matches and answers; each returns diagnostics or refuses the pair."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "answer_checks": "diagnose epipole1_px",
        "known_motion": "motion_prior rotation_of_quaternion",
        "pair_checks": "Apart check_lens check_parallax parallax_px refuse_identical refuse_mirrored refuse_unmatched",
        "wording": "beside",
    },
)
