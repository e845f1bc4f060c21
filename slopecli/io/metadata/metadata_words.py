"""What an image states, in words."""

from __future__ import annotations

from slopecli.io.metadata.image_metadata import Attitude, Metadata
from slopecli.options import Position


def metadata_lines(metadata: Metadata) -> list[str]:
    """A line for each thing that an image states, its name first; what could not be used, and why, comes last."""
    made_by = " ".join(filter(None, (metadata.maker, metadata.model)))
    size = "{}x{} px as stored".format(*metadata.size)
    if metadata.taken_size is not None and metadata.taken_size != metadata.size:
        size += ", {}x{} px as taken".format(*metadata.taken_size)
    if metadata.orientation != 1:
        size += f", to be shown turned (EXIF orientation {metadata.orientation}), which is not done"
    lens = metadata.lens
    named = (
        ("taken with", f"{made_by or 'an unknown camera'}; {size}"),
        ("lens stated", f"{lens.source}; 1-sigma {100 * lens.sigma:.2g} %" if lens else "no focal length"),
        ("attitude", _attitude(metadata.attitude) if metadata.attitude else "not stated"),
        ("position", _position(metadata.position) if metadata.position else "not stated"),
        ("above take-off", "" if metadata.relative_altitude_m is None else f"{metadata.relative_altitude_m:.2f} m"),
        *(("not used", note) for note in metadata.notes),
    )
    return [f"{name:15s}  {said}" for name, said in named if said]


def _attitude(attitude: Attitude) -> str:
    heading = "unknown" if attitude.yaw_deg is None else f"{attitude.yaw_deg:.2f}°"
    whose = "the aircraft, whose camera looks down" if attitude.downward else "the camera"
    angles = f"pitch {attitude.pitch_deg:.2f}°, roll {attitude.roll_deg:.2f}°, heading {heading} of {whose}"
    up = ", ".join(f"{value:z.4f}" for value in attitude.up_cam)
    sigmas = f"1-sigma {attitude.tilt_sigma_deg:.2g}° against gravity"
    if attitude.yaw_deg is not None:
        sigmas += f", {attitude.yaw_sigma_deg:.2g}° of the heading"
    return f"{angles} ({attitude.source}): up is ({up}) in camera axes; {sigmas}"


def _position(position: Position) -> str:
    north = f"{abs(position.latitude_deg):.7f}° {'N' if position.latitude_deg >= 0 else 'S'}"
    east = f"{abs(position.longitude_deg):.7f}° {'E' if position.longitude_deg >= 0 else 'W'}"
    sigmas = f"1-sigma {position.sigma_m:.2g} m"
    if position.altitude_m is None:
        return f"{north} {east}; {sigmas}"
    return f"{north} {east}, {position.altitude_m:.1f} m up; {sigmas}, {position.sigma_up_m:.2g} m up"
