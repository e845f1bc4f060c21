"""All reading and writing of files: images, cameras, correspondences, poses, outputs."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "correspondences": "MATCH_FORMATS read_correspondences read_label_image",
        "files": "read_file remove_temporary write_atomically",
        "images": "MAX_PIXELS image_from_pixels load_image",
        "lock": "locked",
        "outputs": "check_directory load_schema write_map write_outputs",
        "frame_sources": "FrameSource VideoChoice open_camera open_frames read_times",
        "line_files": "LineFile read_lines",
        "pair_sources": "natural_key",
        "poses": "load_pose",
        "prior_files": "read_priors with_frame_priors",
        "study_files": "FIGURES STUDY_NAMES TIMED",
        "temporary": "temporary_folder",
    },
)
