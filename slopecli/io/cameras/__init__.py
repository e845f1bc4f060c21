"""Camera files: told apart by content, each format read by one function."""

from slopecli.io.cameras.reading import load_camera

__all__ = ["load_camera"]
