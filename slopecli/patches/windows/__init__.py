"""The finder of planes that is told where they are: rectangles of image 1, each matched by itself."""
