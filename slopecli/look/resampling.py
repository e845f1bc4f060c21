"""An image as another camera at the same place would have taken it: a sequence has one camera for all its frames."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from slopecli.geometry.camera import pixels_from_rays, rays_from_pixels
from slopecli.types import Camera, Image

Maps = tuple[NDArray[np.float32], NDArray[np.float32]]


def resampled(image: Image, taken_by: Camera, wanted: Camera) -> Image:
    """The image with the pixels of the camera wanted; those that the other does not show repeat its border."""
    if _rays_of(taken_by) == _rays_of(wanted):
        return image

    def seen(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
        maps = _maps(taken_by, wanted)
        return np.asarray(cv2.remap(pixels, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE), np.uint8)

    return replace(image, grey=seen(image.grey), colour=None if image.colour is None else seen(image.colour))


def _rays_of(camera: Camera) -> tuple[object, ...]:
    """What the rays of its pixels depend on."""
    lens = camera.model, camera.distortion
    return camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy, *lens


@lru_cache(maxsize=2)
def _maps(taken_by: Camera, wanted: Camera) -> Maps:
    """Where the pixels of the camera wanted are in an image of the other, u and v."""
    columns, rows = np.meshgrid(np.arange(wanted.width), np.arange(wanted.height))
    rays = rays_from_pixels(wanted, np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
    places = np.nan_to_num(pixels_from_rays(taken_by, rays), nan=-1e6, posinf=1e6, neginf=-1e6)
    u, v = np.clip(places, -1e6, 1e6).astype(np.float32).T.reshape(2, wanted.height, wanted.width)
    return np.ascontiguousarray(u), np.ascontiguousarray(v)
