"""All reading and writing of files: images, cameras, correspondences, poses, outputs."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "atomic": "remove_temporary write_atomically",
        "correspondences": "read_correspondences",
        "images": "MAX_PIXELS load_image",
        "lock": "locked",
        "outputs": "check_directory write_outputs",
        "pair_sources": "natural_key",
        "poses": "load_pose",
        "schema": "load_schema",
        "study_files": "FIGURES STUDY_NAMES TIMED",
    },
)
