"""The joint solution: one motion and one normal per patch, with covariance and every root."""
