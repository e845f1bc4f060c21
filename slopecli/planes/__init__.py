"""Which correspondences are held coplanar: one module per finder of planes."""

from slopecli.planes.ransac import label_planes

__all__ = ["label_planes"]
