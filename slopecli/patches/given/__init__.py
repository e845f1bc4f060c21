"""Correspondences that a user brings, as patches."""
