"""Camera files: one module a format, recognised by content, listed in `CAMERA_FORMATS`."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "content": "CameraFileContent",
        "formats": "CAMERA_FORMATS CameraFormat",
        "reading": "camera_for camera_from_fov camera_from_intrinsics camera_names decode_camera fit_camera_to_image "
        "load_camera",
    },
)
