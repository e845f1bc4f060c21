"""From a Report to the bytes of each output file; one file a format."""
