"""slopemap: slopes of planes and how certain they are, from two overlapping images.

>>> import slopecli as sm
>>> report = sm.estimate("first.png", "second.png", camera="camera.json", grid=(4, 3))
>>> [(plane.slope_deg, plane.slope_sigma_deg) for plane in report.planes]

All public names are here, imported when they are first used. docs/conventions.md has frames and
units, docs/api.md every name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from slopecli.face import lazy_names

__version__ = "0.1.0"

if TYPE_CHECKING:
    from slopecli.errors import DegenerateConfiguration as DegenerateConfiguration
    from slopecli.errors import InputError as InputError
    from slopecli.errors import NoAnswer as NoAnswer
    from slopecli.errors import SlopemapError as SlopemapError
    from slopecli.errors import WrongArgument as WrongArgument
    from slopecli.geometry.slope import measure_slopes as measure_slopes
    from slopecli.geometry.solver.solve import solve_planes as solve_planes
    from slopecli.ground.slope_map import SlopeMap as SlopeMap
    from slopecli.io.cameras.reading import camera_from_fov as camera_from_fov
    from slopecli.io.cameras.reading import camera_from_intrinsics as camera_from_intrinsics
    from slopecli.io.cameras.reading import load_camera as load_camera
    from slopecli.io.correspondences.match_formats import read_correspondences as read_correspondences
    from slopecli.io.images import load_image as load_image
    from slopecli.io.metadata.applied import apply_metadata as apply_metadata
    from slopecli.io.metadata.metadata_reading import read_metadata as read_metadata
    from slopecli.io.outputs import write_map as write_map
    from slopecli.io.outputs import write_outputs as write_outputs
    from slopecli.io.poses import load_pose as load_pose
    from slopecli.library.calls import estimate as estimate
    from slopecli.library.calls import slope_map as slope_map
    from slopecli.options import CameraChoice as CameraChoice
    from slopecli.options import Lander as Lander
    from slopecli.options import MapOptions as MapOptions
    from slopecli.options import MetadataChoice as MetadataChoice
    from slopecli.options import Options as Options
    from slopecli.options import Pose as Pose
    from slopecli.patches.uncalibrated.correspondence_labels import label_planes as label_planes
    from slopecli.pipeline import solve as solve
    from slopecli.products.slopes_json import report_to_json as report_to_json
    from slopecli.types import Camera as Camera
    from slopecli.types import Image as Image
    from slopecli.types import Plane as Plane
    from slopecli.types import Report as Report
    from slopecli.types import Slopes as Slopes
    from slopecli.types import Solution as Solution
else:
    _NAMES = {
        "errors": "DegenerateConfiguration InputError NoAnswer SlopemapError WrongArgument",
        "geometry": "measure_slopes solve_planes",
        "ground": "SlopeMap",
        "io": "load_image load_pose read_correspondences write_map write_outputs",
        "io.cameras": "camera_from_fov camera_from_intrinsics load_camera",
        "io.metadata": "apply_metadata read_metadata",
        "library": "estimate slope_map",
        "options": "CameraChoice Lander MapOptions MetadataChoice Options Pose",
        "patches": "label_planes",
        "pipeline": "solve",
        "products": "report_to_json",
        "types": "Camera Image Plane Report Slopes Solution",
    }
    __all__ = sorted(" ".join(_NAMES.values()).split())
    __getattr__, __dir__ = lazy_names(__name__, _NAMES)
