"""A small pair of images that the installed package carries: ground seen from a descent, 800 x 800 px, in metres."""
