"""Correspondences labelled by plane, by minimising one energy: the finder ransac, and label_planes."""
