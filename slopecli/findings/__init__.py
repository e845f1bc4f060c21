"""Checks of a pair and of its planes: functions from facts to diagnostics, with one row a code in `codes.CODES`."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "camera_checks": "implausible_cameras unlikely with_aspect",
        "camera_test": "CameraTest",
        "checks": "check_answer check_pair",
        "codes": "CODES LIMITS",
        "facts": "AnswerFacts PairFacts epipole1_px",
        "focal_use": "focal_note focal_to_use",
        "level_evidence": "LevelOdds SUPPORTED Seen odds_of_camera odds_of_plane",
        "known_motion": "motion_prior rotation_of_quaternion",
        "pair_checks": "check_lens refuse_identical refuse_mirrored refuse_unmatched",
        "parallax": "check_parallax parallax_px",
        "plane_checks": "focus_of_expansion_in_plane",
        "wording": "Separation beside finding forbid_safe forbidding",
    },
)
