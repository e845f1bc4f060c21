"""The only code that opens files: images, cameras, and everything that is written."""
