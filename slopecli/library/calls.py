"""`estimate` and `slope_map` as Python users call them; what they give becomes the arguments of `pipeline`."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any

from slopecli import pipeline
from slopecli.errors import WrongArgument
from slopecli.ground.slope_map import SlopeMap
from slopecli.library.camera_argument import WANTED, CameraLike, camera_from
from slopecli.library.image_argument import ImageLike, image_from
from slopecli.library.keywords import divide_keywords, with_keywords
from slopecli.look.features import FeatureMemory
from slopecli.options import MapOptions, Options
from slopecli.patches import PLANE_FINDERS
from slopecli.pipeline import LOGGER, OnStage
from slopecli.types import Camera, Diagnostic, Image, Report

CONTRADICTING = ("windows", "grid"), ("baseline_m", "altitude_m")
Pair = tuple[Image, Image, Camera, Camera]


def estimate(
    image1: ImageLike,
    image2: ImageLike,
    camera1: CameraLike | None = None,
    camera2: CameraLike | None = None,
    options: Options | None = None,
    *,
    camera: CameraLike | None = None,
    memory: FeatureMemory | None = None,
    on_stage: OnStage | None = None,
    **choices: Any,
) -> Report:
    """Slope of every window, or of every plane found in image 1, with its uncertainty.

    >>> report = estimate("first.png", "second.png", camera="camera.yaml", grid=(4, 3), up_sigma_deg=0.5)

    Parameters
    ----------
    image1, image2 : path, NumPy array (grey, or BGR as OpenCV reads images; any depth) or `Image`, not undistorted.
    camera : of both images: path of a camera file (FILE#NAME picks one of several), `Camera`, dict in the form of a
        native camera file, (fx, fy, cx, cy) in px, 3x3 matrix, or `CameraChoice`. One of the same view in another size
        is scaled to the image.
    camera1, camera2 : of each image, in the same forms; camera2 alone may be another than `camera`.
    options : `Options`; choices : its fields by name, which replace those of `options`.
    memory : cache of SIFT features, for pairs that share images.
    on_stage : called with the name of every stage and its processor time, s. The logger "slopecli" has them at DEBUG,
        notes and diagnostics at INFO.

    Raises
    ------
    WrongArgument : an InputError and a TypeError; an argument has a wrong type or an unknown name.
    InputError : a file, an array or a camera is unusable, or a window is not inside image 1.
    NoAnswer : the pair has no solution (no overlap, texture or parallax, pure rotation), with reason and remedy.
    """
    (named,) = divide_keywords(choices, Options)
    wanted = _options(options, named)
    pair = _pair(image1, image2, camera, camera1, camera2)
    report = pipeline.estimate(*pair, wanted, memory=memory, on_stage=on_stage)
    _log(report.diagnostics)
    return report


def slope_map(
    image1: ImageLike,
    image2: ImageLike,
    camera1: CameraLike | None = None,
    camera2: CameraLike | None = None,
    options: Options | None = None,
    wanted: MapOptions | None = None,
    *,
    camera: CameraLike | None = None,
    memory: FeatureMemory | None = None,
    on_stage: OnStage | None = None,
    **choices: Any,
) -> SlopeMap:
    """Slope, its uncertainty and the probability of being safe all over image 1, and landing sites.

    >>> found = slope_map("first.png", "second.png", camera="camera.yaml", baseline_m=1.2, footprint_m=3.0)

    As in `estimate`, the windows of the options determine the motion; `SlopeMap.report` has planes through matches.

    Parameters
    ----------
    image1, image2, camera, camera1, camera2, memory, on_stage : as for `estimate`.
    options : `Options`; wanted : `MapOptions`, size of the footprints, limits, sites; choices : fields of both by name.

    Raises
    ------
    WrongArgument : an InputError and a TypeError; an argument has a wrong type or an unknown name.
    InputError : a file, an array, a camera or a window is unusable, or the pixels cannot serve what is wanted.
    NoAnswer : the pair has no solution, with reason and remedy.
    """
    named, of_map = divide_keywords(choices, Options, MapOptions)
    settings, wishes = _options(options, named), with_keywords(wanted, MapOptions, "wanted", of_map)
    pair = _pair(image1, image2, camera, camera1, camera2)
    found = pipeline.slope_map(*pair, settings, wishes, memory=memory, on_stage=on_stage)
    _log(found.report.diagnostics)
    return found


def _options(given: Options | None, named: Mapping[str, Any]) -> Options:
    """The options of a pair. WrongArgument if there is no such finder of planes."""
    options = with_keywords(given, Options, "options", named)
    if options.planes not in PLANE_FINDERS:
        near = get_close_matches(str(options.planes), [*PLANE_FINDERS], n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise WrongArgument(f"planes: is {options.planes!r}, needed one of {', '.join(PLANE_FINDERS)}{hint}")
    for pair in CONTRADICTING:
        if all(named.get(name) for name in pair):
            raise WrongArgument(f"{' and '.join(pair)} are both given; keep one of them")
    return options


def _pair(
    image1: ImageLike,
    image2: ImageLike,
    both: CameraLike | None,
    camera1: CameraLike | None,
    camera2: CameraLike | None,
) -> Pair:
    """The images and cameras of a pair; both: the camera of both images, where they have none of their own."""
    if both is not None and camera1 is not None:
        raise WrongArgument("camera and camera1 are both given; keep one of them")
    first = both if camera1 is None else camera1
    if first is None:
        raise WrongArgument(f"camera: is missing, {WANTED}")
    images = image_from(image1, "image1"), image_from(image2, "image2")
    name = "camera1" if both is None else "camera"
    second, name2 = (first, name) if camera2 is None else (camera2, "camera2")
    (one, notes1), (other, notes2) = camera_from(first, images[0], name), camera_from(second, images[1], name2)
    of_images = (
        f"{image.path or given}: {image.note}"
        for image, given in zip(images, ("image1", "image2"), strict=True)
        if image.note
    )
    for note in dict.fromkeys((*of_images, *notes1, *notes2)):
        LOGGER.info("%s", note)
    return *images, one, other


def _log(diagnostics: tuple[Diagnostic, ...]) -> None:
    for one in diagnostics:
        LOGGER.info("%s: %s: %s", one.severity, one.code, one.message)
