"""Camera files: told apart by content, each format read by one function."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "colmap": "MODELS",
        "reading": "camera_for camera_from_fov camera_from_intrinsics decode_camera fit_camera_to_image load_camera",
    },
)
