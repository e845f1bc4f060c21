"""Pixels to correspondences: detection, matching, dense flow guided by what is already known. No files."""
