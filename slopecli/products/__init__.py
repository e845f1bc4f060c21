"""The output files: one row of `PRODUCTS` a file, one module a format, from a Report to bytes. Light to import."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

from slopecli.face import lazy_names

if TYPE_CHECKING:
    from slopecli.ground.slope_map import SlopeMap
    from slopecli.products.origin import Origin
    from slopecli.sequence.frame import SequenceAnswer
    from slopecli.types import Image, Report

    Answer = Report | SlopeMap | SequenceAnswer

RESULT, OVERLAY, MAP_PICTURE = "slopes.json", "overlay.png", "map.png"


@dataclass(frozen=True)
class Product:
    """One output file.

    Attributes
    ----------
    file : its name in the output folder.
    what : what it is, as part of a sentence; for help texts and docs/output.md.
    encoder : "module:function" of this package, (Report or map, Image 1) -> bytes, or a picture
        (h, w, 3) uint8 BGR, which is written as PNG; imported when it is called.
    choice : name of the user's choice to have it, "" if it is always made; several files may share one.
    by_default : whether it is made unless declined.
    of_origin : whether the encoder is given the `Origin` as well.
    part : attribute of the answer of a sequence that the encoder is given in place of the answer.
    requires : attribute of an answer without which there is no such file: planes found in the image, a segmentation,
        a map; "place": the place and heading of camera 1, and metres; "placed map": both.
    """

    file: str
    what: str
    encoder: str
    choice: str = ""
    by_default: bool = True
    requires: Literal["", "found", "segmentation", "map", "place", "placed map"] = ""
    of_origin: bool = False
    part: Literal["", "report", "map"] = ""

    @property
    def parameter(self) -> str:
        """Name of the command line's parameter: "no_overlay" declines a file, "debug_images" asks for one."""
        return f"no_{self.choice}" if self.by_default else self.choice

    @property
    def flag(self) -> str:
        """The same as users write it: --no-overlay, --debug-images."""
        return "--" + self.parameter.replace("_", "-")

    def is_made(self, answer: Answer, keep: Collection[str]) -> bool:
        """Whether an answer gives this file if the user wants those of the choices `keep`."""
        wanted = not self.choice or self.choice in keep
        if self.requires in ("place", "placed map"):
            wanted = wanted and is_georeferenced(answer)
            return wanted and (self.requires == "place" or bool(getattr(answer, "map", None)))
        return wanted and (not self.requires or bool(getattr(answer, self.requires)))

    def encode(self, answer: Answer, image: Image, origin: Origin | None = None) -> bytes:
        """Return the content of the file; `image` is image 1, `origin` what a page says besides the answer."""
        module, function = self.encoder.split(":")
        more = (origin,) if self.of_origin else ()
        of = getattr(answer, self.part) if self.part else answer
        content = getattr(import_module(f"{__name__}.{module}"), function)(of, image, *more)
        if isinstance(content, bytes):
            return content
        from slopecli.products.drawing.canvas import encode_picture

        return encode_picture(content)


def is_georeferenced(answer: Answer) -> bool:
    """Whether its places on the earth are known: position of camera 1, direction of north, and lengths in metres."""
    report: Any = getattr(answer, "report", answer)
    place = report.place
    known = place is not None and place.position is not None and place.north_cam1 is not None
    return bool(known and report.scale.unit == "m")


# in the order in which they appear in the folder; the last one completes an answer
_Page = partial(
    Product, "report.html", "the answer as a page to look at", choice="report", by_default=False, of_origin=True
)
_Step = partial(Product, choice="debug_images", by_default=False, requires="segmentation")
_Csv = partial(Product, "planes.csv", "the planes as a table: slope, dip, strike, area")
_GeoJson = partial(Product, "slopes.geojson", "planes and sites on the earth, for a GIS", requires="place")
_PolygonStyle = partial(Product, "slopes.qml", "their outlines in QGIS", "polygon_style:encode", requires="place")
PRODUCTS = (
    _Step("step1_gradient.png", "the gradient of image 1", "steps:draw_gradient"),
    _Step("step2_components.png", "the connected regions below its threshold", "steps:draw_components"),
    _Step("step3_merged.png", "the regions after merging, with the ids of the planes", "steps:draw_merged"),
    _Page(encoder="page.report_page:encode"),
    Product(OVERLAY, "image 1 with slopes, sigmas and verdicts", "overlay:draw_overlay", "overlay"),
    Product("patches.ply", "the planes and both cameras in space", "ply:encode", "ply"),
    Product(
        "patches.glb",
        "planes that were found, not windows, with image 1 as texture",
        "glb:encode",
        "glb",
        requires="found",
    ),
    Product("labels_colour.png", "the planes of labels.png in colours", "label_colours:draw_labels_colour", "overlay"),
    Product("labels.png", "the id of the plane of every pixel", "drawing.canvas:encode_labels"),
    _Csv(encoder="planes_csv:encode"),
    _GeoJson(encoder="geojson:encode"),
    _PolygonStyle(),
    Product(RESULT, "the answer, complete", "slopes_json:encode"),
)
MAP_PRODUCTS = (
    Product(
        MAP_PICTURE, "image 1 with the slope of every place, and landing sites", "map_picture:draw_map", "pictures"
    ),
    Product("map_sigma.png", "image 1 with the 1-sigma of these slopes", "map_picture:draw_sigma", "pictures"),
    _Page(encoder="page.report_page:encode_map"),
    Product("cloud.ply", "the ground as a cloud of points, by slope", "cloud_ply:encode", "ply", by_default=False),
    Product("slope_map.tif", "the map as bands of numbers", "map_tiff:encode"),
    Product("slope_map.qml", "its colours in QGIS", "map_style:encode"),
    Product(
        "slope_map_geo.tif", "the map from above, at its place on the earth", "map_geotiff:encode", requires="place"
    ),
    Product("slope_map_geo.qml", "its colours in QGIS", "map_style:encode", requires="place"),
    _Csv(encoder="planes_csv:encode_map"),
    _GeoJson(encoder="geojson:encode_map"),
    _PolygonStyle(),
    Product(RESULT, "the answer, complete, but for the cells of the map", "slopes_json:encode_map"),
)
_OfMap = partial(Product, requires="map", part="map")
_OfPlacedMap = partial(Product, requires="placed map", part="map")
SEQUENCE_PRODUCTS = (
    _OfMap(MAP_PICTURE, "the first frame with the slope of every place", "map_picture:draw_map"),
    _OfMap("map_sigma.png", "the first frame with the 1-sigma of these slopes", "map_picture:draw_sigma"),
    _OfMap("slope_map.tif", "the map as bands of numbers", "map_tiff:encode"),
    _OfMap("slope_map.qml", "its colours in QGIS", "map_style:encode"),
    _OfPlacedMap("slope_map_geo.tif", "the map from above, at its place on the earth", "map_geotiff:encode"),
    _OfPlacedMap("slope_map_geo.qml", "its colours in QGIS", "map_style:encode"),
    _Page(encoder="sequence_files:encode_page"),
    Product(
        OVERLAY, "the first frame with slopes, sigmas and verdicts", "overlay:draw_overlay", "overlay", part="report"
    ),
    Product("trajectory.txt", "where the camera was, in TUM format", "sequence_files:encode_trajectory"),
    _Csv(encoder="planes_csv:encode", part="report"),
    _GeoJson(encoder="sequence_files:encode_places"),
    _PolygonStyle(),
    Product(RESULT, "the last answer, with the motions of all frames", "sequence_files:encode_sequence"),
)
VIDEO = "sequence.mp4"  # of a sequence, if it is asked for
STREAM = "sequence.jsonl"  # of a sequence, written while it runs
# all that a folder may hold, so that files of an earlier command do not stay beside those of another
_FILES = dict.fromkeys(one.file for one in (*PRODUCTS, *MAP_PRODUCTS, *SEQUENCE_PRODUCTS) if one.file != RESULT)
OUTPUT_NAMES = (STREAM, *_FILES, VIDEO, RESULT)
CHOICES = tuple(dict.fromkeys(product.choice for product in PRODUCTS if product.choice))
BY_DEFAULT = frozenset(product.choice for product in PRODUCTS if product.choice and product.by_default)


def keep_files(**choices: bool) -> frozenset[str]:
    """Return which of `CHOICES` a user wants: the defaults but for those given, as in `keep_files(overlay=False)`."""
    unknown = sorted(set(choices) - set(CHOICES))
    if unknown:
        raise TypeError(f"there is no choice {unknown[0]!r} of files; choose among {', '.join(CHOICES)}")
    return frozenset(choice for choice in CHOICES if choices.get(choice, choice in BY_DEFAULT))


def kept_choices(parameters: Mapping[str, Any], products: Sequence[Product] = PRODUCTS) -> frozenset[str]:
    """Return which choices a command's parameters leave or add: `Product.parameter` -> whether its flag is set."""
    return frozenset(p.choice for p in products if p.choice and bool(parameters[p.parameter]) != p.by_default)


def encode_products(
    answer: Answer,
    image: Image,
    keep: Collection[str] = BY_DEFAULT,
    products: Sequence[Product] = PRODUCTS,
    origin: Origin | None = None,
) -> dict[str, bytes]:
    """Return the files of a report, or with `MAP_PRODUCTS` of a map, by name, slopes.json first.

    Parameters
    ----------
    image : image 1.
    keep : which choices of the products the user wants.
    origin : what report.html says besides the answer.
    """
    from slopecli.look.threads import single_threaded

    with single_threaded():
        made = (product for product in reversed(products) if product.is_made(answer, keep))
        return {product.file: product.encode(answer, image, origin) for product in made}


def encode_rows(report: Report, keep: Collection[str] = BY_DEFAULT, origin: Origin | None = None) -> dict[str, bytes]:
    """Return the files of a report of a user's own correspondences, without an image, as `encode_products`."""
    import numpy as np

    from slopecli.types import Image

    of_rows = [product for product in PRODUCTS if product.choice == "report" or product.file == RESULT]
    return encode_products(report, Image(np.zeros((0, 0), np.uint8)), keep, of_rows, origin)


__getattr__, __dir__ = lazy_names(
    __name__,
    {
        "cloud_ply": "MOST_POINTS map_to_ply",
        "georeference": "Georeference",
        "map_geotiff": "map_to_geotiff orthographic",
        "map_style": "map_to_qml",
        "plane_measures": "measures_of",
        "planes_frame": "report_to_dataframe",
        "planes_csv": "COLUMNS report_to_csv",
        "glb": "LARGEST_TEXTURE_PX model_from_camera1 report_to_glb",
        "map_picture": "draw_map draw_sigma",
        "map_tiff": "BANDS NODATA map_to_tiff",
        "origin": "Origin",
        "overlay": "draw_overlay",
        "polygon_style": "polygons_to_qml",
        "ply": "planes_mesh report_to_ply",
        "sequence_files": "frame_line sequence_to_json",
        "region_mesh": "MOST_TRIANGLES region_grid region_surfaces",
        "slopes_json": "map_to_json report_to_json",
        "steps": "draw_components draw_gradient draw_merged",
    },
)
