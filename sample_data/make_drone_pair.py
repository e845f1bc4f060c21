"""Write the pair of `descent/` as the JPEG files of a drone, with all that it would state, to try `--metadata` on.

    python sample_data/make_drone_pair.py flight

writes flight/DJI_0031.JPG and DJI_0032.JPG: the images, and in EXIF and XMP, under the names that DJI gives them, the
calibration of the lens, the angles of the gimbal and the place by a receiver with corrections. All of it is true: image
1 looks straight down with its top towards 120 degrees. Needs numpy, SciPy, Pillow and pyproj, and a second.
"""

from __future__ import annotations

import argparse
import io
import json
import struct
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
from PIL import Image
from pyproj import Geod
from scipy.spatial.transform import Rotation

DESCENT = Path(__file__).parent / "descent"
NAMES = ("DJI_0031.JPG", "DJI_0032.JPG")
HEADING_DEG = 120.0
LATITUDE_DEG, LONGITUDE_DEG, GROUND_M = 46.5763, 8.0158, 1669.0
HEIGHT_M = 13.0  # of image 1 above the ground
RTK_SIGMA_M = 0.01
XMP_HEADER = b"http://ns.adobe.com/xap/1.0/\0"
NED_1 = Rotation.from_euler("ZYX", [HEADING_DEG, 0, 0], degrees=True).as_matrix() @ [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
AHEAD = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # x ahead, y right, z down, of a camera's x right, y down, z ahead


def drone_tags(number: int) -> dict[str, str]:
    """What DJI's XMP states of image 1 or 2."""
    truth, camera = (json.loads((DESCENT / name).read_text()) for name in ("truth.json", "camera.json"))
    yaw, pitch, roll, moved = HEADING_DEG, -90.0, 0.0, np.zeros(3)
    if number == 2:
        ned_2 = NED_1 @ np.transpose(truth["R"])
        yaw, pitch, roll = Rotation.from_matrix(ned_2 @ AHEAD.T).as_euler("ZYX", degrees=True)
        moved = NED_1 @ truth["T"]
    north, east, down = moved
    azimuth, metres = np.degrees(np.arctan2(east, north)), np.hypot(north, east)
    longitude, latitude, _ = Geod(ellps="WGS84").fwd(LONGITUDE_DEG, LATITUDE_DEG, azimuth, metres)
    k1, k2, p1, p2, k3 = camera["distortion"]
    return {
        "GimbalYawDegree": f"{yaw:+.2f}",
        "GimbalPitchDegree": f"{pitch:+.2f}",
        "GimbalRollDegree": f"{roll:+.2f}",
        "GpsLatitude": f"{latitude:+.9f}",
        "GpsLongitude": f"{longitude:+.9f}",
        "AbsoluteAltitude": f"{GROUND_M + HEIGHT_M - down:+.3f}",
        "RelativeAltitude": f"{HEIGHT_M - down:+.3f}",
        "RtkStdLat": f"{RTK_SIGMA_M}",
        "RtkStdLon": f"{RTK_SIGMA_M}",
        "RtkStdHgt": f"{2 * RTK_SIGMA_M}",
        "DewarpData": f"2026-01-01;{camera['fx']:.4f},{camera['fy']:.4f},0,0,{k1},{k2},{p1},{p2},{k3}",
        "DewarpFlag": "0",
    }


def xmp_packet(values: dict[str, str]) -> bytes:
    """An XMP packet with these values in DJI's namespace."""
    attributes = " ".join(f"drone-dji:{name}={quoteattr(value)}" for name, value in values.items())
    return (
        '<?xpacket begin="" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
        'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about="" '
        f'xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" {attributes}/></rdf:RDF></x:xmpmeta>'
        '<?xpacket end="w"?>'
    ).encode("ascii")


def drone_photograph(number: int) -> bytes:
    """The JPEG file of image 1 or 2."""
    exif, file = Image.Exif(), io.BytesIO()
    exif[0x010F], exif[0x0110] = "slopemap", "rendered drone"
    with Image.open(DESCENT / f"image{number}.png") as picture:
        picture.save(file, "JPEG", quality=97, exif=exif)
    jpeg, segment = file.getvalue(), XMP_HEADER + xmp_packet(drone_tags(number))
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + jpeg[2:]


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="where the two files go")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for number, name in enumerate(NAMES, 1):
        (folder / name).write_bytes(drone_photograph(number))


if __name__ == "__main__":
    main()
