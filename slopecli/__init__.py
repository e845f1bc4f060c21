"""slopemap: how steep the ground is, patch by patch, and how sure we are, from two overlapping images."""

__version__ = "0.1.0"
