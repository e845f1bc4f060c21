"""What to do where OpenCV cannot be used: it is missing, cannot be loaded, or wheels overwrote each other's files."""

from __future__ import annotations

KEPT = "opencv-contrib-python-headless"
WHEELS = ("opencv-python", "opencv-python-headless", "opencv-contrib-python", KEPT)


def explain_opencv(error: Exception) -> str | None:
    """One line about an error that OpenCV's installation has made; None for any other error.

    All wheels of OpenCV install the same folder: the last one wins, and removing one breaks those that are left.
    """
    missing = isinstance(error, ImportError) and (
        error.name == "cv2" or "cv2" in str(error.path) or "libGL" in str(error)
    )
    broken = isinstance(error, AttributeError) and "module 'cv2' has no attribute" in str(error)
    if not missing and not broken:
        return None
    found = [name for name in WHEELS if _is_installed(name)]
    if not found:
        return f"OpenCV is not installed; install it with: pip install {KEPT}"
    remove = f"pip uninstall -y {' '.join(found)} && pip install {KEPT}"
    if len(found) > 1:
        return f"OpenCV cannot be used ({error}): {' and '.join(found)} share their files; keep one: {remove}"
    return f"OpenCV cannot be used ({error}), of {found[0]}; install it anew: {remove}"


def _is_installed(name: str) -> bool:
    from importlib import metadata  # which takes 20 ms, a fifth of what the help takes

    try:
        metadata.version(name)
    except metadata.PackageNotFoundError:
        return False
    return True
