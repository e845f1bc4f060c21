"""What is read of an image file besides its pixels: lens, place and attitude, and what is refused, by name."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from camera_factory import brown_image, check_pixels, directions
from metadata_factory import (
    DJI,
    FOCAL_35,
    FOCAL_MM,
    HEIGHT,
    LENS_MODEL,
    MAKER_NOTE,
    PLACE,
    PLANE_UNIT,
    PLANE_X,
    PLANE_Y,
    WIDTH,
    apple_note,
    exif_block,
    gimbal,
    gps_tags,
    photograph,
    with_xmp,
    xmp_packet,
)
from numpy.testing import assert_allclose
from PIL import Image as PilImage
from PIL.PngImagePlugin import PngInfo

from slopecli.geometry import ned_displacement, ned_from_camera
from slopecli.io.metadata import Attitude, Metadata, decode_metadata, read_metadata, xmp_values

SIZE = (400, 300)
PARROT = "http://www.parrot.com/drone-parrot/1.0/"
DEWARP = "2021-05-11;3680.5,3681.5,11.25,-7.5,-0.27,0.11,0.0002,-0.0003,-0.03"
WHOLE = (5472, 3648)


def read(size: tuple[int, int] = SIZE, **how: Any) -> Metadata:
    return decode_metadata(photograph(size, **how), "image.jpg")


def dji(**values: Any) -> Metadata:
    return read(xmp=xmp_packet(values))


# ---- attitude ----


def axes(attitude: Attitude | None) -> np.ndarray:
    """Columns: where the image's right, its bottom and the line of sight point, north, east, down."""
    assert attitude is not None
    return attitude.ned_from_camera


@pytest.mark.parametrize(
    ("angles", "right", "down", "ahead"),
    [
        ((0, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 0)),  # looks north, upright
        ((90, 0, 0), (-1, 0, 0), (0, 0, 1), (0, 1, 0)),  # looks east
        ((0, -90, 0), (0, 1, 0), (-1, 0, 0), (0, 0, 1)),  # straight down, the top of the image to the north
        ((90, -90, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 1)),  # straight down, the top to the east
        ((0, 0, 90), (0, 0, 1), (0, -1, 0), (1, 0, 0)),  # looks north, the camera turned clockwise
        ((180, -90, 180), (0, 1, 0), (-1, 0, 0), (0, 0, 1)),  # as a gimbal past straight down states it
    ],
)
def test_angles_are_north_east_down(angles: tuple[float, ...], right: Any, down: Any, ahead: Any) -> None:
    assert_allclose(ned_from_camera(*angles), np.transpose([right, down, ahead]), atol=1e-12)


def test_gimbal_gives_up_and_north() -> None:
    attitude = dji(**gimbal(30.0, -60.0)).attitude
    assert attitude is not None
    assert_allclose(attitude.up_cam, (0, -math.cos(math.radians(60)), -math.sin(math.radians(60))), atol=1e-12)
    assert attitude.north_cam is not None
    assert_allclose(np.dot(attitude.up_cam, attitude.north_cam), 0, atol=1e-12)
    assert_allclose(axes(attitude)[:2, 2], 0.5 * np.array([math.cos(math.pi / 6), math.sin(math.pi / 6)]), atol=1e-12)


def test_angles_that_are_all_zero_are_not_level() -> None:
    metadata = dji(**gimbal(0, 0, 0))
    assert metadata.attitude is None
    assert "all 0" in " ".join(metadata.notes)


def test_angles_of_the_aircraft_are_not_those_of_its_camera() -> None:
    assert dji(FlightYawDegree="+12", FlightPitchDegree="-3", FlightRollDegree="+1").attitude is None


def test_a_heading_may_be_missing() -> None:
    attitude = dji(GimbalPitchDegree="-80", GimbalRollDegree="0").attitude
    assert attitude is not None
    assert attitude.north_cam is None
    assert attitude.up_cam[2] < -0.98


def test_a_body_without_a_gimbal_has_a_larger_sigma() -> None:
    angles = {"Heading": "59.2", "PitchAngle": "6.9", "RollAngle": "5.5"}
    attitude = read(xmp=xmp_packet(angles, "http://ns.sensefly.com/sensefly/1.0/", "sensefly")).attitude
    assert attitude is not None
    assert (attitude.source, attitude.tilt_sigma_deg) == ("senseFly", 5.0)
    tilts = np.sin(np.radians([5.5, 6.9]))
    assert_allclose(np.abs(attitude.up_cam[:2]), tilts * [np.cos(np.radians(6.9)), 1], atol=1e-9)


def test_body_angles_look_down_at_zero() -> None:
    packet = xmp_packet({"Yaw": 90, "Pitch": 0, "Roll": 0}, "http://pix4d.com/camera/1.0", "Camera")
    assert_allclose(axes(read(xmp=packet).attitude), ned_from_camera(90, -90, 0), atol=1e-12)


def test_parrot_states_its_camera_twice() -> None:
    """Angles of a camera that looks ahead, and Pix4D's of one that looks down: the example of its documentation."""
    ahead = {"CameraYawDegree": 146.848, "CameraPitchDegree": -51.988888, "CameraRollDegree": -0.0}
    looks_ahead = read(xmp=xmp_packet(ahead, PARROT, "drone-parrot")).attitude
    looks_down = {"Yaw": 146.848, "Pitch": 38.011101, "Roll": 0.0}
    other = read(xmp=xmp_packet(looks_down, "http://pix4d.com/camera/1.0/", "Camera")).attitude
    assert_allclose(axes(looks_ahead), axes(other), atol=1e-6)
    assert_allclose(axes(looks_ahead)[2, 2], math.sin(math.radians(51.988888)), atol=1e-9)
    assert looks_ahead is not None
    assert looks_ahead.source == "Parrot camera"


def test_autel_states_its_camera_as_pix4d_or_as_dji() -> None:
    old = read(xmp=xmp_packet({"Yaw": 20, "Pitch": 30, "Roll": 0}, "http://pix4d.com/camera/1.0/", "Camera"))
    new = read(xmp=xmp_packet(gimbal(20, -60), prefix="drone"))
    assert_allclose(axes(old.attitude), axes(new.attitude), atol=1e-9)


BACK = "iPhone 7 Plus back dual camera 3.99mm f/1.8"


def telephone(pitch: float, held: float, size: tuple[int, int] = SIZE, lens: str = BACK, g: float = 1.0) -> Metadata:
    """A photograph by a telephone of this pitch, held turned clockwise by `held` from upright."""
    down = g * np.array([math.cos(math.radians(pitch)), -math.sin(math.radians(pitch))])  # down in the view, and ahead
    right, top = down[0] * math.sin(math.radians(held)), -down[0] * math.cos(math.radians(held))
    note = apple_note(right, top, -down[1])
    orientation = {0: 6, 90: 3, 180: 8, 270: 1}[round(held / 90) * 90 % 360] if size[0] > size[1] else 1
    place = {**gps_tags(*PLACE), 0x10: "T", 0x11: 123.5}
    return read(size, exif={MAKER_NOTE: note, LENS_MODEL: lens}, gps=place, main={274: orientation})


@pytest.mark.parametrize("held", [0, 90, 270, 10, 260])
@pytest.mark.parametrize("pitch", [0, -50, 20])
def test_gravity_of_a_telephone(held: float, pitch: float) -> None:
    """Held upright, or on a side, as the pixels of the sensor have it: its top is at the left of the pixels."""
    attitude = telephone(pitch, held).attitude
    assert attitude is not None
    top = math.radians(held + 180)  # of the scene, clockwise from the right of the pixels as stored
    flat = math.cos(math.radians(pitch))
    up = (flat * math.cos(top), -flat * math.sin(top), math.sin(math.radians(pitch)))
    assert_allclose(attitude.up_cam, up, atol=1e-5)
    assert_allclose(
        axes(attitude)[:2, 2] / flat, (math.cos(math.radians(123.5)), math.sin(math.radians(123.5))), atol=1e-5
    )


def test_gravity_of_pixels_that_a_program_turned() -> None:
    attitude = telephone(-30, 0, SIZE[::-1]).attitude
    assert attitude is not None
    assert_allclose(attitude.up_cam, (0, -math.cos(math.pi / 6), -math.sin(math.pi / 6)), atol=1e-5)


def test_straight_down_a_telephone_has_no_heading() -> None:
    attitude = telephone(-88, 0).attitude
    assert attitude is not None
    assert attitude.up_cam[2] < -0.999
    assert attitude.north_cam is None


@pytest.mark.parametrize(
    ("metadata", "said"),
    [
        (telephone(-30, 0, lens="iPhone 7 Plus front camera 2.87mm f/2.2"), "camera at the back"),
        (telephone(-30, 0, g=1.3), "1.30 g"),
        (telephone(-30, 135), "does not fit its EXIF orientation"),
        (telephone(-88, 0, SIZE[::-1]), "turned after it was taken"),
    ],
)
def test_gravity_that_cannot_be_used_is_named(metadata: Metadata, said: str) -> None:
    assert metadata.attitude is None
    assert said in " ".join(metadata.notes)


def test_a_damaged_note_of_the_maker_is_none() -> None:
    whole = apple_note(0, -1, 0)
    for note in (
        whole[:40],
        whole[:14],
        whole[:-4],
        whole.replace(b"MM", b"XX"),
        whole[:-4] + bytes(4),
        b"Apple iOS\0",
    ):
        assert read(exif={MAKER_NOTE: note, LENS_MODEL: BACK}).attitude is None


@pytest.mark.parametrize(("orientation", "turn"), [(6, 90), (8, 270), (3, 180)])
def test_angles_of_turned_pixels(orientation: int, turn: int) -> None:
    """Of the two readings that has the top of the image as shown up: angles of what is shown, or of what is stored."""
    shown = read(xmp=xmp_packet(gimbal(20, -30)), main={274: orientation})
    stored = read(xmp=xmp_packet(gimbal(20, -30, turn)), main={274: orientation})
    assert_allclose(axes(shown.attitude), axes(stored.attitude), atol=1e-9)
    up = np.array(shown.attitude.up_cam) if shown.attitude else np.zeros(3)
    top = {6: (-1, 0), 8: (1, 0), 3: (0, 1)}[orientation]  # where the top as shown is in the pixels as stored
    assert_allclose(up[:2] / np.linalg.norm(up[:2]), top, atol=1e-9)
    assert f"orientation {orientation}" in " ".join(shown.notes)


def test_a_mirrored_image_has_no_attitude() -> None:
    metadata = read(xmp=xmp_packet(gimbal(20, -30)), main={274: 2})
    assert metadata.attitude is None
    assert "mirrors" in metadata.notes[0]


@pytest.mark.parametrize(("letter", "heading"), [("T", 123.5), ("M", None), ("", None)])
def test_heading_of_a_telephone(letter: str, heading: float | None) -> None:
    metadata = read(gps={**gps_tags(*PLACE), 0x10: letter, 0x11: 123.5})
    assert metadata.heading_deg == heading
    assert (heading is None) == ("true north" in " ".join(metadata.notes))


# ---- place ----


def test_place_of_exif_and_of_xmp() -> None:
    latitude, longitude = PLACE
    position = read(gps=gps_tags(-latitude, -longitude, 412.3)).position
    assert position is not None
    assert_allclose((position.latitude_deg, position.longitude_deg), (-latitude, -longitude), atol=1e-9)
    assert position.altitude_m == pytest.approx(412.3)
    misspelt = dji(
        GpsLatitude="+47.3769", GpsLongtitude="+8.5417", AbsoluteAltitude="+412.30", RelativeAltitude="+30.1"
    )
    assert misspelt.position is not None
    assert (misspelt.position.latitude_deg, misspelt.position.longitude_deg) == PLACE
    assert misspelt.relative_altitude_m == 30.1


def test_a_fix_with_corrections_has_the_sigma_it_states() -> None:
    fixed = dji(
        GpsLatitude="47", GpsLongitude="8", RtkFlag="50", RtkStdLat="0.011", RtkStdLon="0.014", RtkStdHgt="0.03"
    )
    plain = dji(GpsLatitude="47", GpsLongitude="8")
    assert fixed.position is not None
    assert plain.position is not None
    assert (fixed.position.sigma_m, fixed.position.sigma_up_m) == (0.014, 0.03)
    assert plain.position.sigma_m > plain.position.apart_sigma_m > 10 * fixed.position.apart_sigma_m


@pytest.mark.parametrize(
    ("gps", "said"),
    [
        ({**gps_tags(*PLACE), 1: "X"}, "incomplete"),
        ({2: gps_tags(*PLACE)[2]}, "incomplete"),
        (gps_tags(0, 0), "without a fix"),
        (gps_tags(91, 8), "no globe"),
        ({**gps_tags(*PLACE), 0x12: "TOKYO"}, "not of WGS 84"),
    ],
)
def test_a_place_that_cannot_be_used_is_named(gps: dict[int, Any], said: str) -> None:
    metadata = read(gps=gps)
    assert metadata.position is None
    assert said in " ".join(metadata.notes)


def test_displacements_are_those_of_the_ellipsoid() -> None:
    """Against the lengths of arcs at 45 degrees of latitude: 111 132 m a degree north, 78 847 m a degree east."""
    assert_allclose(ned_displacement(45, 179.9995, 45, -179.9995, 0), (0, 78.847, 0), atol=2e-3)
    assert_allclose(ned_displacement(44.9995, 8, 45.0005, 8, 5), (111.132, 0, -5), atol=2e-3)


# ---- lens ----


def test_calibration_of_the_maker() -> None:
    """The camera matrix of DJI's guide: (fx, 0, middle + cx), (0, fy, middle + cy), and OpenCV's distortion."""
    lens = read(
        WHOLE, xmp=xmp_packet({"DewarpData": DEWARP, "DewarpFlag": "0", "CalibratedFocalLength": "3666.7"})
    ).lens
    assert lens is not None
    camera, x = lens.camera(), directions()
    across, down = brown_image(x, -0.27, 0.11, -0.03, 0.0002, -0.0003)
    check_pixels(camera, x, 3680.5 * across + 5471 / 2 + 11.25, 3681.5 * down + 3647 / 2 - 7.5)
    assert camera.source.startswith("EXIF: DJI DewarpData")
    assert lens.sigma < 0.01


def test_a_calibration_with_six_radial_terms_goes_before_that_with_three() -> None:
    six = "2025-01-07;3680.5,3681.5,11.25,-7.5,-0.1,0.02,0.0002,-0.0003,0.01,0.12,0.03,0.005"
    lens = read(WHOLE, xmp=xmp_packet({"DewarpData": DEWARP, "DewarpDataK6": six})).lens
    assert lens is not None
    x = directions()
    across, down = brown_image(x, -0.1, 0.02, 0.01, 0.0002, -0.0003, 0.12, 0.03, 0.005)
    check_pixels(lens.camera(), x, 3680.5 * across + 5471 / 2 + 11.25, 3681.5 * down + 3647 / 2 - 7.5)
    cut = read(WHOLE, xmp=xmp_packet({"DewarpData": DEWARP, "DewarpDataK6": six.rpartition(",")[0]})).lens
    assert cut is not None
    assert (cut.source, cut.distortion[0]) == ("DJI DewarpData", -0.27)


def test_calibration_of_an_image_made_smaller() -> None:
    """A program that shrinks an image may write its new size into EXIF; the centre stated tells what it was."""
    packet = xmp_packet(
        {"DewarpData": DEWARP, "CalibratedOpticalCenterX": "2736.0", "CalibratedOpticalCenterY": "1824.0"}
    )
    for size in ((1368, 912), (1368, 770)):  # the second is cut in height, as 16:9 of a sensor of 3:2 is
        lens = read(size, exif={WIDTH: size[0], HEIGHT: size[1]}, xmp=packet).lens
        assert lens is not None
        assert lens.fx == pytest.approx(3680.5 / 4)
        assert lens.centre_px == pytest.approx((11.25 / 4, -7.5 / 4))


def test_an_image_already_undistorted_has_no_distortion() -> None:
    lens = read(WHOLE, xmp=xmp_packet({"DewarpData": DEWARP, "DewarpFlag": "1"})).lens
    assert lens is not None
    assert lens.camera().model == "pinhole"
    assert "already taken out" in lens.source


def test_focal_length_in_millimetres() -> None:
    """13.2 mm of sensor across 400 px; the same in other units, and of an image that was made half as large."""
    exif = {FOCAL_MM: 8.8, PLANE_X: 400 / 1.32, PLANE_Y: 400 / 1.32, PLANE_UNIT: 3, WIDTH: 400, HEIGHT: 300}
    focal = 8.8 * 400 / 13.2
    inches = {**exif, PLANE_X: 400 / 13.2 * 25.4, PLANE_Y: 400 / 13.2 * 25.4, PLANE_UNIT: 2}
    for tags in (exif, inches):
        lens = read(exif=tags).lens
        assert lens is not None
        assert lens.fx == pytest.approx(focal, rel=1e-6)
    half = read((200, 150), exif=exif).lens
    assert half is not None
    assert half.fx == pytest.approx(focal / 2, rel=1e-6)
    assert "resized by 0.5" in half.source
    assert half.camera().cx == 99.5
    turned = read((300, 400), exif=exif).lens
    assert turned is not None
    assert turned.fx == pytest.approx(focal, rel=1e-6)


@pytest.mark.parametrize("size", [(400, 300), (300, 400), (400, 225), (400, 267)])
def test_35_mm_equivalent_is_within_its_sigma_of_both_conventions(size: tuple[int, int]) -> None:
    lens = read(size, exif={FOCAL_35: 24}).lens
    assert lens is not None
    across = 24 / 36 * max(size)
    sensor = math.hypot(400, 300) if size[1] < 240 or 300 in size else math.hypot(*size)
    diagonal = 24 / math.hypot(36, 24) * sensor
    assert lens.fx == pytest.approx(diagonal, rel=5e-3)
    assert abs(math.log(across / lens.fx)) < 2 * lens.sigma
    assert 0.02 < lens.sigma < 0.05


@pytest.mark.parametrize(
    ("size", "exif", "xmp", "said"),
    [
        (SIZE, {FOCAL_MM: 8.8}, {}, "no size of the sensor"),
        (SIZE, {FOCAL_35: 24, FOCAL_MM: 8.8, PLANE_X: 4000, PLANE_Y: 4000}, {}, "contradict each other"),
        ((300, 300), {FOCAL_35: 24, WIDTH: 400, HEIGHT: 300}, {}, "was cut"),
        ((3648, 5472), {WIDTH: 5472, HEIGHT: 3648}, {"DewarpData": DEWARP}, "was turned"),
        (SIZE, {FOCAL_35: 65535}, {}, "cannot be used"),
        (WHOLE, {}, {"DewarpData": DEWARP.replace("11.25,-7.5", "2736,1824")}, "from a corner"),
    ],
)
def test_a_lens_that_cannot_be_used_is_named(size: Any, exif: Any, xmp: Any, said: str) -> None:
    metadata = read(size, exif=exif, xmp=xmp_packet(xmp) if xmp else b"")
    assert metadata.lens is None
    assert said in " ".join(metadata.notes)


# ---- other files than JPEG ----


@pytest.mark.parametrize("suffix", ["png", "webp", "tiff"])
def test_metadata_of_other_formats(tmp_path: Path, suffix: str) -> None:
    packet, path = xmp_packet(gimbal(30, -60, GpsLatitude="47", GpsLongitude="8")), tmp_path / f"image.{suffix}"
    exif = exif_block({FOCAL_35: 24})
    picture = PilImage.new("L", SIZE, 128)
    if suffix == "webp":
        picture.save(path, exif=exif, xmp=packet)
    elif suffix == "png":
        text = PngInfo()
        text.add_itxt("XML:com.adobe.xmp", packet.decode())
        picture.save(path, exif=exif, pnginfo=text)
    else:
        picture.save(path, tiffinfo={700: packet})
    metadata = read_metadata(path)
    assert (metadata.lens is None) == (suffix == "tiff")
    assert metadata.attitude is not None
    assert metadata.attitude.pitch_deg == -60
    assert metadata.position is not None
    assert not metadata.notes


# ---- hostile and damaged metadata ----


def test_nothing_stated_is_nothing_read() -> None:
    metadata = decode_metadata(photograph(SIZE), "image.jpg")
    assert metadata == Metadata("image.jpg", SIZE, 1)


@pytest.mark.parametrize(
    "packet",
    [
        b'<!DOCTYPE x [<!ENTITY a "b"><!ENTITY c "&a;&a;&a;">]><x>&c;</x>',
        '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/hostname">]><x>&a;</x>'.encode("utf-16"),
        b'<!DOCTYPE x SYSTEM "http://example.invalid/x.dtd"><x/>',
    ],
)
def test_entities_are_refused(packet: bytes) -> None:
    assert xmp_values(packet) == ({}, "declares a document type, which no XMP does")


def test_huge_and_deep_packets_are_refused_or_read_in_no_time() -> None:
    assert xmp_values(b"<x>" * 400_000)[1].startswith("has 1200000 bytes")
    assert xmp_values(b"<x>" * 300_000 + b"</x>" * 10)[0] == {}


def test_what_stands_before_damage_is_kept() -> None:
    packet = xmp_packet(gimbal(30, -60)).replace(b"</rdf:RDF>", b"</x>")
    metadata = decode_metadata(photograph(SIZE, xmp=packet), "image.jpg")
    assert metadata.attitude is not None
    assert "damaged" in metadata.notes[0]


def test_values_may_be_elements() -> None:
    element = f'<r:D xmlns:r="r" xmlns:d="{DJI}"><d:GimbalPitchDegree> -45.0 </d:GimbalPitchDegree></r:D>'.encode()
    assert xmp_values(element)[0][(DJI, "GimbalPitchDegree")] == "-45.0"


@pytest.mark.parametrize("odd", ["nan", "inf", "1e999", "", "twelve", "+-3", "1/0", "9" * 5000])
def test_odd_numbers_are_none(odd: str) -> None:
    metadata = dji(**gimbal(10, -60) | {"GimbalPitchDegree": odd, "RelativeAltitude": odd, "GpsLatitude": odd})
    assert metadata.attitude is None
    assert metadata.relative_altitude_m is None
    assert metadata.position is None


def test_a_file_without_tags_says_so(tmp_path: Path) -> None:
    (tmp_path / "image.bmp").write_bytes(b"BM" + struct.pack("<IHHI", 70, 0, 0, 54) + bytes(56))
    metadata = read_metadata(tmp_path / "image.bmp")
    assert "no kind that has them" in metadata.notes[0]
    cut = with_xmp(photograph(SIZE), xmp_packet(gimbal(1, 2)))[:200]
    assert decode_metadata(cut, "cut.jpg").attitude is None
