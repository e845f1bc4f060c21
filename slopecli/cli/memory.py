"""How the process of one pair asks for memory."""

from __future__ import annotations

from contextlib import suppress

# glibc's numbers of what is set, and the values, bytes
_TRIM_THRESHOLD, _KEPT = -1, 2**28
_MMAP_THRESHOLD, _LARGE = -3, 2**24


def keep_freed_memory() -> None:
    """Let the C library keep what is freed, up to 256 MB, for the next array, unless that is of 16 MB or more.

    Otherwise it hands every larger array back to the system and asks for it anew, to be cleared page by page: for a
    megapixel a twentieth of the whole processor time. Does nothing where there is no glibc.
    """
    import ctypes  # NumPy loads it anyway

    with suppress(OSError, TypeError, AttributeError):  # no C library of that name, or one without the function
        mallopt = ctypes.CDLL("libc.so.6").mallopt
        # to set one ends its adaptation to the sizes seen, so both are
        mallopt(_TRIM_THRESHOLD, _KEPT)
        mallopt(_MMAP_THRESHOLD, _LARGE)
