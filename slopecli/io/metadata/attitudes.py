"""The attitude of the camera out of the XMP of drones: one row a maker's set of names.

Sources: DJI's and Parrot's documentation of metadata, Pix4D's of its angles. Autel writes the names of Pix4D, newer
firmware those of DJI.

Angles of the body of an aircraft are not read where it has a gimbal, which turns the camera by its own angles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from slopecli.geometry.attitude import about_line_of_sight
from slopecli.io.metadata.image_metadata import Attitude
from slopecli.io.metadata.image_tags import GpsTag, ImageTags, number_of

DJI = "http://www.dji.com/drone-dji/1.0/"
PARROT = "http://www.parrot.com/drone-parrot/1.0/"


@dataclass(frozen=True)
class AttitudeSigmas:
    """1-sigma of angles, degrees. In flights whose level and motion many images tell, gimbals were off by 1 degree and
    bodies of fixed wings by 4.5; a compass beside motors has 5."""

    gimbal: float = 1.0
    body: float = 5.0  # and any heading
    telephone: float = 10.0  # of its heading


@dataclass(frozen=True)
class AttitudeSource:
    """One set of names for the angles of a camera.

    name : in messages and in docs/drone.md.  namespace : of XMP.  angles : the names of yaw, pitch and roll.
    of_body : whether the angles are those of a body whose camera looks straight down from it, the top of the
    image ahead, in place of those of a gimbal, whose camera looks ahead at zero.
    """

    name: str
    namespace: str
    angles: tuple[str, str, str]
    of_body: bool

    @property
    def tilt_sigma_deg(self) -> float:
        """1-sigma of the direction against gravity, degrees."""
        return SIGMAS.body if self.of_body else SIGMAS.gimbal

    @property
    def yaw_sigma_deg(self) -> float:
        """1-sigma of the heading, degrees."""
        return SIGMAS.body


SIGMAS = AttitudeSigmas()
# the first that has a pitch and a roll is used
ATTITUDE_SOURCES = (
    AttitudeSource("DJI gimbal", DJI, ("GimbalYawDegree", "GimbalPitchDegree", "GimbalRollDegree"), False),
    AttitudeSource("Parrot camera", PARROT, ("CameraYawDegree", "CameraPitchDegree", "CameraRollDegree"), False),
    AttitudeSource("Pix4D camera", "http://pix4d.com/camera/1.0", ("Yaw", "Pitch", "Roll"), True),
    AttitudeSource("senseFly camera", "http://ns.sensefly.com/Camera/1.0/", ("Yaw", "Pitch", "Roll"), True),
    AttitudeSource("senseFly", "http://ns.sensefly.com/sensefly/1.0/", ("Heading", "PitchAngle", "RollAngle"), True),
)


def attitude_of(tags: ImageTags) -> tuple[Attitude | None, str]:
    """The attitude that XMP states, and a note where it states one that cannot be used."""
    for row in ATTITUDE_SOURCES:
        namespaces = (row.namespace, row.namespace + "/")
        yaw, pitch, roll = angles = [_first(tags, namespaces, name) for name in row.angles]
        if pitch is None or roll is None:
            continue
        if not any(angles):
            return None, f"its {row.name} angles are all 0, which is what is written where they are not measured"
        if max(abs(angle) for angle in angles if angle is not None) > 360:
            return None, f"its {row.name} angles are no angles"
        return Attitude(
            pitch,
            roll,
            yaw,
            row.of_body,
            tilt_sigma_deg=row.tilt_sigma_deg,
            yaw_sigma_deg=row.yaw_sigma_deg,
            source=row.name,
        ), ""
    return None, ""


def shown_turn_deg(orientation: int) -> float | None:
    """By how much an image of an EXIF orientation is turned clockwise to be shown; None where it is mirrored."""
    return {1: 0.0, 6: 90.0, 3: 180.0, 8: 270.0}.get(orientation)


def steep(right: float, down: float) -> bool:
    """Whether a camera looks within 18 degrees of straight down or up, by the parts of up, or down, in its image."""
    return right * right + down * down < 0.1


def heading_of(tags: ImageTags) -> tuple[float | None, str]:
    """The heading of a telephone, degrees from true north, and a note where one is stated that cannot be used."""
    heading = number_of(tags.gps.get(GpsTag.DIRECTION))
    if heading is None or not 0 <= heading <= 360:
        return None, ""
    if str(tags.gps.get(GpsTag.DIRECTION_OF) or "").strip("\0 ").upper() != "T":
        return None, "its heading is not said to be from true north"
    return heading, ""


def as_stored(attitude: Attitude, orientation: int) -> tuple[Attitude | None, str]:
    """The attitude with regard to the pixels as stored, of an image with a mark of orientation, and a note about it.

    Some makers state angles of the pixels as stored, some of the image as shown: of the two that one is taken which
    has the top of the image as shown up. Where the camera looks too steeply down to tell, it is the first.
    """
    if orientation == 1:
        return attitude, ""
    turn = shown_turn_deg(orientation)
    if turn is None:
        return None, "its EXIF orientation mirrors the image, so its angles cannot be used"
    shown = replace(attitude, turn_deg=turn)
    (u, v, _), (_, top, _) = attitude.up_cam, (float(x) for x in about_line_of_sight(shown.turn_deg) @ attitude.up_cam)
    marked = f"EXIF orientation {orientation}"
    if steep(u, v):
        return attitude, f"it has {marked}: its angles are taken to be of the pixels as stored, as it looks down"
    if v < top:
        return shown, f"it has {marked}: its angles are those of the image as shown"
    return attitude, f"it has {marked}: its angles are those of the pixels as stored"


def _first(tags: ImageTags, namespaces: tuple[str, ...], name: str) -> float | None:
    found = (tags.xmp_number(namespace, name) for namespace in namespaces)
    return next((value for value in found if value is not None), None)
