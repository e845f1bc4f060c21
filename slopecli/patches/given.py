"""Correspondences given by the user, as patches; solved as exactly planar, or with relief where residuals show some."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import cv2
import numpy as np

from slopecli.errors import InputError
from slopecli.geometry.camera import rays_from_pixels
from slopecli.geometry.solver.priors import MotionPrior
from slopecli.geometry.solver.relief import Flatness, flatness
from slopecli.geometry.solver.solve import solve_planes
from slopecli.geometry.statistics import median
from slopecli.look.matches import Matches
from slopecli.patches.join import Joined
from slopecli.patches.patch import Footprint, Patch
from slopecli.patches.settling import noise_of_each_alone, set_aside_unsettled
from slopecli.types import BoolArray, Camera, FloatArray, IntArray, Solution
from slopecli.windows import box_polygon

WIDEST_RAY = 5.0  # tangent of the angle to the axis
RAYS = Camera(0, 0, 1.0, 1.0, 0.0, 0.0, source="rays")  # stands for no camera: its pixels are rays
FEWEST = 3  # points that make a plane
MOST_LEFT_OUT = 0.25  # share of a patch's rows off its plane beyond which it is not one plane, or of rows at one point


@dataclass(frozen=True, eq=False)
class Given:
    """Correspondences as read: xy1, xy2 (n, 2) px, or rays (normalised coordinates) where there is no camera.

    patch (n,) says which plane a row lies on, -1 for none.  sigma (n,): its 1-sigma in image 2, px or mrad, or None.
    has_patch : whether the file says so itself; without it all rows are on plane 1.
    names : of images 1 and 2 in the file, where it has several.  cameras : of both, where the file has them.
    pixels : whether its points cannot be rays.  note : what is worth knowing of how it was read, or "".
    outlines : of planes that were asked for, px, by number; those without rows have no answer.
    options : how the rows were given to planes, for slopes.json.
    """

    xy1: FloatArray
    xy2: FloatArray
    patch: IntArray
    sigma: FloatArray | None = None
    path: str = ""
    sha256: str = ""
    has_patch: bool = True
    names: tuple[str, str] | None = None
    cameras: tuple[Camera, Camera] | None = None
    pixels: bool = False
    note: str = ""
    outlines: Mapping[int, FloatArray] = field(default_factory=dict)
    options: Mapping[str, object] = field(default_factory=dict)

    @property
    def paths(self) -> tuple[str, str]:
        """Of images 1 and 2 as slopes.json names them: the file, with the name of the image in it."""
        first, second = (f"{self.path}#{name}" for name in self.names) if self.names else (self.path, self.path)
        return first, second

    @property
    def name(self) -> str:
        """What messages call it: its file, where it is of one."""
        return self.path or "the correspondences"

    def refusal(self, why: str) -> InputError:
        """InputError that says what is wrong with it."""
        return InputError(f"{self.name}: {why}")


class Hull(Footprint):
    """Footprint of given points: their convex outline, without pixels, in one piece."""

    @property
    def area_px(self) -> int:
        """Area of the outline in thousandths, as rays have areas far below 1."""
        return round(1e3 * cv2.contourArea(self.polygon_px.astype(np.float32)))

    @property
    def largest_share(self) -> float:
        return 1.0


def join_rows(given: Given, cameras: tuple[Camera, Camera]) -> Joined:
    """The rows as patches with their matches; rows of a patch that makes no plane constrain the motion only.

    InputError : a point given again and again, pixels where rays are needed, points of another image, a pixel without
        a ray, or no patch of three points off a line.
    """
    _check_distinct(given)
    typical = min(median(np.abs(xy).max(axis=1)) for xy in (given.xy1, given.xy2))
    if cameras[0] is RAYS and given.pixels:
        raise given.refusal("its points are pixels; give the camera with --camera or --intrinsics")
    if cameras[0] is RAYS and typical > WIDEST_RAY:  # half of them would be beyond 79 degrees off the axis
        raise given.refusal(
            f"half of the points lie beyond {typical:.4g}, which are pixels and no rays (x/z, y/z); "
            "give the camera with --camera or --intrinsics"
        )
    _check_inside(given, cameras)
    x1, x2 = (_rays(camera, xy) for camera, xy in zip(cameras, (given.xy1, given.xy2), strict=True))
    matches = Matches(given.xy1, given.xy2, x1, x2)
    weight = np.ones(len(matches)) if given.sigma is None else (median(given.sigma) / given.sigma) ** 2
    labels = sorted({*np.unique(given.patch[given.patch >= 0]).tolist(), *given.outlines})
    patches = [_patch(label, matches, weight, given.patch == label, given.outlines.get(label)) for label in labels]
    answered = [patch.id for patch in patches if patch.origin == "own"]
    if not answered:
        raise given.refusal(
            f"no patch has {FEWEST} rows off a line (found {len(labels)} patches in {len(x1)} rows); "
            "give the rows of a plane one number in the column patch"
        )
    outside = ~np.isin(given.patch, answered)
    return Joined.of(patches, matches.take(outside), weight[outside])


def _check_distinct(given: Given) -> None:
    """Raise InputError where more than a quarter of the rows, and four, have one and the same point in an image."""
    for image, xy in ((1, given.xy1), (2, given.xy2)):
        # a number for each place: equal for equal points, and hardly ever for others
        _, first, count = np.unique(xy @ np.array([1.0, 0.7853981]), return_index=True, return_counts=True)
        most = int(count.argmax())
        if count[most] > max(MOST_LEFT_OUT * len(xy), FEWEST):
            u, v = xy[first[most]]
            raise given.refusal(
                f"{count[most]} of {len(xy)} rows have the point ({u:g}, {v:g}) in image {image}; "
                "give each correspondence once, and leave out rows without a match"
            )


def off_image(camera: Camera, uv: FloatArray) -> BoolArray:
    """(n,) which points (n, 2) lie outside the image of a camera by more than where pixels are counted from.

    None of a camera without an image size.
    """
    if not camera.width:
        return np.zeros(len(uv), bool)
    return np.asarray(((uv < -1.0) | (uv > [camera.width, camera.height])).any(axis=1))


def _check_inside(given: Given, cameras: tuple[Camera, Camera]) -> None:
    """Raise InputError where most points of an image lie outside it, some and none with x and y in each other's place,
    or all of both in its first corner, as rays do."""
    if cameras[0] is RAYS:
        return
    pairs = list(zip(cameras, (given.xy1, given.xy2), strict=True))
    largest = max(float(np.abs(xy).max()) for _, xy in pairs)
    if largest < WIDEST_RAY and all(camera.cx > 2.0 * WIDEST_RAY for camera in cameras):
        raise given.refusal(
            f"all points lie within {largest:.3g} px of the first pixel, as rays do (x/z, y/z); needed "
            "pixels with a camera, or leave the camera out"
        )
    for number, (camera, xy) in enumerate(pairs, 1):
        outside = int(np.count_nonzero(off_image(camera, xy)))
        swapped = outside > FEWEST and not off_image(camera, xy[:, ::-1]).any()
        if swapped or 2 * outside > len(xy):
            guess = "are x and y in each other's place?" if swapped else "are they pixels of an image of another size?"
            raise given.refusal(
                f"{outside} of {len(xy)} points of image {number} lie outside its {camera.width}x"
                f"{camera.height} px; {guess}"
            )


def _rays(camera: Camera, xy: FloatArray) -> FloatArray:
    x = xy if camera is RAYS else rays_from_pixels(camera, xy)
    lost = np.flatnonzero(~np.isfinite(x).all(axis=1))
    if len(lost):
        u, v = xy[lost[0]]
        raise InputError(
            f"row {lost[0] + 1}: no ray belongs to the pixel ({u:g}, {v:g}) with this lens; is it the right camera?"
        )
    return x


def _patch(
    label: int, matches: Matches, weight: FloatArray, mine: BoolArray, outline: FloatArray | None = None
) -> Patch:
    """The patch of one label with its rows (mask `mine`), or with none and the reason; outline: that it is to have."""
    own = matches.take(mine)
    if outline is not None and not len(own):
        nothing = Hull((0, 0), np.zeros((0, 0), bool), outline)
        return Patch(label, "given", nothing).unmatched("no row lies in it", "too-few-points")
    corners = own.uv1.astype(np.float32) + np.float32(0.0)  # no -0.0, for which OpenCV has no hull of one point
    polygon = own.uv1[cv2.convexHull(corners, returnPoints=False).ravel()]
    if len(polygon) < 3:
        polygon = box_polygon(own.uv1.min(axis=0), own.uv1.max(axis=0))
    patch, n = Patch(label, "given", Hull((0, 0), np.zeros((0, 0), bool), polygon)), len(own)
    if n < FEWEST:
        return patch.unmatched(f"it has {n} row{'s' if n > 1 else ''}, and a plane needs {FEWEST}", "too-few-points")
    length, width = np.linalg.svd(own.x1 - own.x1.mean(axis=0), compute_uv=False)
    if width * length <= 1.01e-4 * (width**2 + length**2):  # a little more than the solver asks for
        return patch.unmatched(f"its {n} rows lie on one line, which does not fix a plane", "too-few-points")
    return replace(patch, matches=own, weight=weight[mine], origin="own", score=1.0, share=1.0)


@dataclass(frozen=True, eq=False)
class GivenSolution:
    """The solution, the exactly planar one that it may be, and checks of its patches (m,).

    flatness : whether residuals along the epipolar lines exceed those across.  emptied : too many rows lie off the
    exactly planar fit.  unchecked : no more rows are left than determine a plane, so none of them is checked.
    """

    solution: Solution
    exact: Solution
    flatness: Flatness
    emptied: BoolArray
    unchecked: BoolArray


def solve_given(
    joined: Joined, solver: Literal["mle", "ha", "lh"], noise: float | None, prior: MotionPrior | None = None
) -> GivenSolution:
    """One motion and one plane per patch, exactly planar unless the residuals show relief.

    Points whose residuals along the epipolar lines exceed those across bias an exactly planar fit. It is then solved
    once more with relief, as for images.

    noise : 1-sigma of a coordinate of weight 1 in image 2, normalised; None estimates it.
    """
    given = (joined.matches.x1, joined.matches.x2, joined.plane)
    exact = solve_planes(*given, solver, noise, weights=joined.weight, prior=prior)
    counted = joined.plane >= 0
    total, kept = (np.bincount(joined.plane[chosen]) for chosen in (counted, counted & exact.inlier))
    emptied = kept < (1 - MOST_LEFT_OUT) * total
    unchecked = (kept <= FEWEST) & (kept < total)
    if solver == "mle":
        rough = solve_planes(*given, solver, noise, weights=joined.weight, prior=prior, relief=True)
        seen = flatness(rough, *given, joined.weight)
        # a fit with relief takes many mismatches for noise
        if seen.off.any() and rough.noise <= exact.noise:
            return GivenSolution(rough, exact, seen, emptied, unchecked)
    return GivenSolution(exact, exact, flatness(exact, *given, joined.weight), emptied, unchecked)


def settling_rows(
    joined: Joined,
    solved: GivenSolution,
    solver: Literal["mle", "ha", "lh"],
    noise: float | None,
    prior: MotionPrior | None = None,
) -> Joined:
    """The rows without patches that keep the joint solution from settling, see `set_aside_unsettled`.

    solved : of all rows; other arguments as of `solve_given`. Rows are held to the noise given, or to that of each
    patch by itself.
    """
    if solver != "mle":
        return joined

    def solve(some: Joined) -> Solution:
        given = (some.matches.x1, some.matches.x2, some.plane)
        return solve_planes(*given, solver, noise, weights=some.weight, prior=prior)

    most_noise = max(noise_of_each_alone(joined), noise or 0.0, 1e-7)  # rows that agree better are exact
    return set_aside_unsettled(joined, solved.exact, solve, most_noise * (1.0 + 1e-9))
