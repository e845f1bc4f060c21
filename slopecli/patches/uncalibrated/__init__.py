"""Planes of correspondences between two images whose cameras and motion are unknown."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(__name__, {"correspondence_labels": "label_planes"})
