"""The plane around a window inside which nothing can be matched."""

from __future__ import annotations

import numpy as np

from slopecli.geometry.camera import pixels_from_rays
from slopecli.geometry.metrics import normal_angle
from slopecli.planes.scene import Scene
from slopecli.planes.window_match import WindowMatch, no_match
from slopecli.planes.windows import Window
from slopecli.types import FloatArray

LONELY_RAD = np.radians(60.0)  # doubt about a borrowed plane that nothing around the window supports


def borrow(window: Window, scene: Scene) -> WindowMatch:
    """Matches around the window that lie on the plane it most likely belongs to: near it and of its brightness."""
    evidence = scene.evidence
    x, y, w, h = window
    grey = scene.pyramid1.at(1.0).grey[y : y + h, x : x + w]
    centre, side = np.array([x + w / 2, y + h / 2]), max(w, h)
    brightness = float(np.median(grey))
    for grow in (0.75, 1.5, 3.0):
        near = evidence.near(window, grow)
        if near.sum() < 20:
            continue
        offset = np.linalg.norm(evidence.uv1 - centre, axis=1) / (side * (0.5 + grow))
        vote = near * np.exp(-(offset**2)) * np.exp(-(((evidence.grey - brightness) / 30.0) ** 2))
        planes = [p for p in (evidence.plane_through(near), *scene.planes) if p is not None]
        support = [float((vote * (evidence.misfit_px(p) < 1.0)).sum()) for p in planes]
        best = int(np.argmax(support))
        chosen = near & (evidence.misfit_px(planes[best]) < 1.0)
        if chosen.sum() < 12 or support[best] < 2.0:
            continue
        index = np.round((evidence.uv1[chosen] - centre) / max(side / 16, 1.0)).astype(np.int64)
        variance = np.full((int(chosen.sum()), 2), 0.3**2)
        return WindowMatch(
            evidence.uv1[chosen],
            pixels_from_rays(scene.camera2, evidence.x2[chosen]),
            evidence.x1[chosen],
            evidence.x2[chosen],
            index[:, ::-1],
            variance,
            "borrowed",
            0.0,
            0.0,
            doubt_rad=max(_disagreement(planes, support, best), LONELY_RAD * (1 - support[best] / float(vote.sum()))),
        )
    return no_match("nothing in or around the window can be matched")


def _disagreement(planes: list[FloatArray], support: list[float], best: int) -> float:
    """RMS angle between the chosen plane and the others, each weighted by the support it has."""
    share = np.array(support) / max(sum(support), 1e-9)
    angles = np.array([float(normal_angle(plane, planes[best])) for plane in planes])
    return float(np.sqrt(share @ np.minimum(angles, np.pi - angles) ** 2))
