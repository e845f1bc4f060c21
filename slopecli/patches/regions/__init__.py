"""The urban procedure: planes found in the image, each with the pixels that lie on it."""
