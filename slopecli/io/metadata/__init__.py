"""What an image file says of how it was taken: EXIF and XMP read into one noun, `Metadata`."""

from slopecli.face import lazy_names

__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "applied": "Displacement apply_metadata displacement",
        "attitudes": "ATTITUDE_SOURCES",
        "image_metadata": "Attitude Lens Metadata",
        "image_tags": "ImageTags read_tags",
        "lenses": "LENS_SOURCES",
        "metadata_reading": "decode_metadata read_metadata",
        "metadata_words": "metadata_lines",
        "xmp_packet": "xmp_values",
    },
)
