"""What the metadata of a pair of images state, as options of an estimate: up, north, scale, place, and the motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.attitude import about_line_of_sight, forward_angles_deg, ned_displacement
from slopecli.geometry.epipolar import checked_direction
from slopecli.io.metadata.attitudes import SIGMAS, shown_turn_deg
from slopecli.io.metadata.image_metadata import Attitude, Metadata
from slopecli.io.metadata.positions import FIX
from slopecli.options import CameraChoice, MetadataChoice, Options, Stated
from slopecli.types import FloatArray

Pair = tuple[Metadata, Metadata]
GIVEN = "given"


@dataclass(frozen=True)
class Displacement:
    """ned_m : from camera 1 to camera 2, metres north, east, down.  sigmas_m : 1-sigma of each."""

    ned_m: FloatArray
    sigmas_m: FloatArray

    @property
    def length_m(self) -> float:
        """Distance between the cameras."""
        return float(np.linalg.norm(self.ned_m))

    @property
    def sigma_m(self) -> float:
        """1-sigma of that distance; of cameras at one place that of the distance in the worst direction."""
        along = self.ned_m / self.length_m if self.length_m else np.ones(3)
        return float(np.linalg.norm(along * self.sigmas_m))


def apply_metadata(
    pair: Pair, choice: MetadataChoice, options: Options, cameras: tuple[CameraChoice, ...] = ()
) -> Options:
    """The options of an estimate with what the metadata of both images state in their place.

    Sigmas of the options that are not 0 stay, as does a focal sigma.

    Parameters
    ----------
    pair : metadata of images 1 and 2.  choice : what is wanted of them.
    cameras : of both images, for the uncertainty of focal lengths that are from metadata; () where none is.

    Raises
    ------
    InputError : what must be taken from the metadata is not stated there, or not well enough.
    """
    attitude = _attitude(pair[0], choice)
    compared = choice != MetadataChoice()  # not where the camera alone is from there
    second = None if attitude is None or attitude.source == GIVEN else pair[1].attitude
    moved = displacement(pair)
    wanted = _Wanted(pair, choice)
    place = pair[0].position if compared or any(camera.exif for camera in cameras) else None
    options, stated = (
        replace(options, position=options.position or place),
        _stated(attitude if compared else None, second, moved),
    )
    options, stated = wanted.frame(options, stated, attitude)
    options, stated = wanted.scale(options, stated, moved)
    options = wanted.focal_sigma(options, cameras)
    return replace(options, stated=_with_differences(pair[0], options, replace(stated, notes=wanted.notes())))


def _with_differences(image1: Metadata, options: Options, stated: Stated) -> Stated:
    """`stated` with the differences of the user's up and position from those of image 1, where it states these."""
    if image1.attitude is not None and isinstance(options.up, tuple) and not stated.up:
        up = checked_direction("up", options.up)
        # who knows that a program turned the pixels by quarters gives the angles of what there is
        turned = (about_line_of_sight(90.0 * quarters) @ np.array(image1.attitude.up_cam) for quarters in range(4))
        apart = math.degrees(math.acos(max(-1.0, min(1.0, max(float(up @ one) for one in turned)))))
        sigma = math.hypot(image1.attitude.tilt_sigma_deg, options.up_sigma_deg, 1.0)  # given to whole degrees
        stated = replace(stated, up_off_deg=apart, up_off_sigma_deg=sigma)
    if image1.position is not None and options.position is not None and options.position != image1.position:
        one, other = options.position, image1.position
        places = (one.latitude_deg, one.longitude_deg, other.latitude_deg, other.longitude_deg)
        stated = replace(stated, position_off_m=float(np.linalg.norm(ned_displacement(*places, 0.0))))
    return stated


def displacement(pair: Pair) -> Displacement | None:
    """The way from camera 1 to camera 2 by the positions stated; None where one is not known."""
    one, two = pair[0].position, pair[1].position
    if one is None or two is None:
        return None
    apart = math.hypot(one.apart_sigma_m, two.apart_sigma_m)
    heights = pair[0].relative_altitude_m, pair[1].relative_altitude_m
    climb, sigma_up = 0.0, math.hypot(one.sigma_up_m, two.sigma_up_m)
    if heights[0] is not None and heights[1] is not None:
        climb, sigma_up = heights[1] - heights[0], min(FIX.climb, 2 * apart)
    elif one.altitude_m is not None and two.altitude_m is not None:
        climb, sigma_up = two.altitude_m - one.altitude_m, 2 * apart  # heights of satellite fixes have twice the sigma
    places = (one.latitude_deg, one.longitude_deg, two.latitude_deg, two.longitude_deg)
    return Displacement(ned_displacement(*places, climb), np.array([apart, apart, sigma_up]))


def _attitude(image1: Metadata, choice: MetadataChoice) -> Attitude | None:
    """The attitude of camera 1: as stated, but for the angles that the user gives, which are of the image as shown."""
    given = choice.yaw_deg, choice.pitch_deg, choice.roll_deg
    if given == (None, None, None):
        return image1.attitude
    turn = shown_turn_deg(image1.orientation)
    if turn is None:
        raise InputError(f"{image1.path}: its EXIF orientation mirrors the image; give --up X,Y,Z in place of angles")
    asked = {*choice.must, *choice.may}
    stated = image1.attitude if {"up", "north"} & asked else None
    heading = image1.heading_deg if "north" in asked else None
    yaw, pitch, roll = (_first(one, own) for one, own in zip(given, _angles_of(stated, turn, heading), strict=True))
    if pitch is None or roll is None:
        what = "states no angles of its camera; give --pitch DEG too (-90 looks straight down)"
        raise InputError(f"{image1.path}: {what}")
    sigmas = (0.0, 0.0) if stated is None else (stated.tilt_sigma_deg, stated.yaw_sigma_deg)
    if choice.yaw_deg is None and heading is not None and yaw == heading:
        sigmas = (sigmas[0], SIGMAS.telephone)
    tilt, azimuth = sigmas
    return Attitude(pitch, roll, yaw, turn_deg=turn, tilt_sigma_deg=tilt, yaw_sigma_deg=azimuth, source=GIVEN)


def _angles_of(stated: Attitude | None, turn: float, heading: float | None) -> tuple[float | None, ...]:
    """Yaw, pitch and roll of a camera that looks ahead, of the image as shown; without an attitude it is upright.

    turn : by which the image is shown, degrees clockwise.  heading : where it is stated alone.
    """
    if stated is None:
        return heading, None, 0.0
    yaw, *others = forward_angles_deg(stated.ned_from_camera @ about_line_of_sight(-turn))
    return (heading if stated.yaw_deg is None else yaw, *others)


def _first(one: float | None, other: float | None) -> float | None:
    return other if one is None else one


def _stated(first: Attitude | None, second: Attitude | None, moved: Displacement | None) -> Stated:
    """What is compared with the answer."""
    if first is None or first.yaw_deg is None:
        return Stated()
    sigma = math.hypot(first.tilt_sigma_deg, first.yaw_sigma_deg)
    both = Stated(
        attitude1=tuple(first.ned_from_camera.ravel().tolist()),
        attitude2=None if second is None or second.yaw_deg is None else tuple(second.ned_from_camera.ravel().tolist()),
        attitude_sigma_deg=max(sigma, 1.0),  # an angle that is given is a whole number of degrees, more or less
    )
    if moved is None or not 0 < moved.length_m < FIX.farthest:
        return both
    north, east, down = (float(metres) for metres in moved.ned_m)
    across = math.degrees(float(moved.sigmas_m.max()) / moved.length_m)
    return replace(both, move_m=(north, east, down), move_sigma_deg=math.hypot(across, both.attitude_sigma_deg))


class _Wanted:
    """Takes what is wanted, and collects in words what was taken and what is missing."""

    def __init__(self, pair: Pair, choice: MetadataChoice) -> None:
        self._pair, self._choice = pair, choice
        self._used: list[str] = []
        self._missing: dict[str, list[str]] = {}  # names by the reason why they are missing

    def notes(self) -> tuple[str, ...]:
        """One line of what was taken, one of what is missing, and what the files have that cannot be used."""
        taken = [f"from the metadata of the images: {', '.join(self._used)}"] if self._used else []
        lacking = "; ".join(f"{', '.join(names)} ({why})" for why, names in self._missing.items())
        missing = [f"not in the metadata of the images: {lacking}"] if lacking else []
        if not missing and not taken:  # angles are given, and nothing is asked of the files
            return ()
        others = (f"{one.path}: {note}" for one in self._pair for note in one.notes)
        return (*taken, *missing, *(note for note in others if note not in "".join(missing)))

    def _asked(self, name: str) -> bool:
        return name in self._choice.must or name in self._choice.may

    def _lacks(self, name: str, flag: str, why: str, instead: str) -> None:
        """Refuse, or note, that something is not stated."""
        if name in self._choice.must:
            raise InputError(f"{flag}: {why}; {instead}")
        self._missing.setdefault(why, []).append(name)

    def frame(self, options: Options, stated: Stated, attitude: Attitude | None) -> tuple[Options, Stated]:
        """Up and north by the attitude of camera 1."""
        image, given = self._pair[0], attitude is not None and attitude.source == GIVEN
        why = _unusable(image, "angles", f"{image.path} states no angles of its camera")
        if attitude is None:
            if self._asked("up"):
                self._lacks("up", "--up exif", why, "give --pitch and --roll, or another --up")
            if self._asked("north"):
                self._lacks("north", "--north exif", why, "give --pitch and --yaw, or --north X,Y,Z")
            return options, stated
        if self._asked("up") or given:
            sigma = options.up_sigma_deg or attitude.tilt_sigma_deg
            options, stated = replace(options, up=attitude.up_cam, up_sigma_deg=sigma), replace(stated, up=not given)
            self._say(given, f"up ({_angles(attitude)}, ± {sigma:g}°)")
        north = attitude.north_cam
        if north is None and self._asked("north"):
            self._lacks("north", "--north exif", f"{image.path} states no heading", "give --yaw, or --north X,Y,Z")
        elif north is not None and (self._asked("north") or self._choice.yaw_deg is not None):
            sigma = options.north_sigma_deg or attitude.yaw_sigma_deg
            options = replace(options, north=north, north_sigma_deg=sigma)
            self._say(given, f"north (yaw {attitude.yaw_deg:g}°, ± {sigma:g}°)")
        return options, stated

    def _say(self, given: bool, text: str) -> None:
        if not given:
            self._used.append(text)

    def scale(self, options: Options, stated: Stated, moved: Displacement | None) -> tuple[Options, Stated]:
        """The baseline by two positions, or the height above take-off where its sigma was given."""
        if self._asked("baseline"):
            why = self._no_baseline(moved)
            if moved is not None and not why:
                sigma = options.scale_sigma_percent or 100.0 * moved.sigma_m / moved.length_m
                self._used.append(f"baseline {moved.length_m:.4g} m ± {sigma:.2g} % (two positions)")
                options = replace(options, baseline_m=moved.length_m, scale_sigma_percent=sigma)
                return options, replace(stated, scale=True)
            self._lacks("baseline", "--baseline exif", why, "give --baseline M or --altitude M")
        if self._asked("altitude"):
            return self._altitude(options, stated)
        return options, stated

    def _no_baseline(self, moved: Displacement | None) -> str:
        """Why the positions give no baseline, "" where they do."""
        if moved is None:
            lacking = next(image for image in self._pair if image.position is None)
            return _unusable(lacking, "GPS", f"{lacking.path} states no GPS position")
        if moved.length_m > FIX.farthest:
            return f"the positions are {moved.length_m / 1e3:.0f} km apart, which is not one flight"
        if moved.sigma_m > FIX.most_share * moved.length_m:
            return f"the positions are {moved.length_m:.2g} m apart, which is known to ± {moved.sigma_m:.2g} m"
        return ""

    def _altitude(self, options: Options, stated: Stated) -> tuple[Options, Stated]:
        image, flag = self._pair[0], "--altitude exif"
        height = image.relative_altitude_m
        if height is None or height <= 0:
            self._lacks("altitude", flag, f"{image.path} states no height above take-off", "give --altitude M")
            return options, stated
        if not options.scale_sigma_percent:
            why = f"{image.path} states {height:g} m above the place of take-off, which may not be the ground seen here"
            self._lacks("altitude", flag, why, "say by --scale-sigma PERCENT how well that is the height above it")
            return options, stated
        self._used.append(f"altitude {height:g} m ± {options.scale_sigma_percent:g} % (above take-off)")
        return replace(options, altitude_m=height), replace(stated, scale=True)

    def focal_sigma(self, options: Options, cameras: tuple[CameraChoice, ...]) -> Options:
        """The uncertainty of focal lengths that are from metadata, unless one was given."""
        lenses = [image.lens for image, camera in zip(self._pair, cameras, strict=False) if camera.exif]
        known = [lens for lens in lenses if lens is not None]
        if known:
            each = dict.fromkeys(f"{lens.source}: {lens.fx:.5g} px ± {100 * lens.sigma:.2g} %" for lens in known)
            self._used.append(f"focal length ({' and '.join(each)})")
        if not known or options.focal_sigma_percent is not None:
            return options
        return replace(options, focal_sigma_percent=100.0 * max(lens.sigma for lens in known))


def _unusable(image: Metadata, subject: str, otherwise: str) -> str:
    """Why something is not known: the note of the file that names it, or that it is not there."""
    note = next((note for note in image.notes if subject in note), None)
    return otherwise if note is None else f"{image.path}: {note}"


def _angles(attitude: Attitude) -> str:
    return f"{attitude.source} pitch {attitude.pitch_deg:g}°, roll {attitude.roll_deg:g}°"
