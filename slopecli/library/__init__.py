"""The functions of `import slopecli` that take files, arrays and keywords: what is given becomes images and cameras."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "calls": "estimate slope_map",
        "camera_argument": "CameraLike",
        "image_argument": "ImageLike",
    },
)
