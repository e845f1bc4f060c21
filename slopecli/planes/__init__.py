"""Which correspondences are held coplanar: one module per finder of planes."""
