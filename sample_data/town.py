"""The sample town: convex solids made of textured faces, and trees made of leaf balls.

World axes: x east, y north, z up, metres; the ground is z = 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from materials import Grain, Material, Surface, facade, flat_roof, foliage, ground, paint, seamed_roof, tiled_roof
from rendering import FloatArray

SEED = 20140
Colour = tuple[float, float, float]  # linear RGB
Size = tuple[float, float, float]  # length, width, height, m
Place = tuple[float, float, float]  # x, y, z in a frame, m

BRICK, SAND_BRICK, PLASTER = (0.27, 0.115, 0.07), (0.36, 0.25, 0.15), (0.47, 0.42, 0.33)
WHITE, BLUE_GREY, OCHRE, CONCRETE = (0.56, 0.55, 0.52), (0.26, 0.31, 0.35), (0.46, 0.30, 0.14), (0.33, 0.32, 0.30)
RED_TILE, BROWN_TILE, SLATE = (0.31, 0.125, 0.075), (0.22, 0.12, 0.075), (0.125, 0.135, 0.155)
BRICKS = (0.46, 0.21)  # length and course of the blocks, m; coarse enough to survive at 8 cm a pixel


@dataclass(frozen=True, eq=False)
class Face:
    """A convex polygon: corners (k, 3) counter-clockwise from outside, the first edge horizontal.

    `plane` names the plane it belongs to in the truth, "" for small parts that are not listed.
    """

    corners: FloatArray
    material: Material
    surface: Surface
    plane: str = ""
    solid: int = -1
    origin: FloatArray = field(init=False)
    along: FloatArray = field(init=False)
    upward: FloatArray = field(init=False)
    normal: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        along = unit(self.corners[1] - self.corners[0])
        normal = unit(np.cross(along, self.corners[-1] - self.corners[0]))
        for name, value in (
            ("origin", self.corners[0]), ("along", along), ("normal", normal), ("upward", np.cross(normal, along))
        ):  # fmt: skip
            object.__setattr__(self, name, value)

    def coordinates(self, points: FloatArray) -> FloatArray:
        """(n, 2) coordinates s, t in metres of points (n, 3) on the face."""
        return (points - self.origin) @ np.stack([self.along, self.upward], axis=1)


@dataclass(frozen=True, eq=False)
class Tree:
    """Leaf balls: centres (k, 3) and radii (k,), m."""

    centres: FloatArray
    radii: FloatArray
    material: Material
    surface: Surface


def unit(vector: FloatArray) -> FloatArray:
    return vector / np.linalg.norm(vector)


def raised(polygon: FloatArray, by: float) -> FloatArray:
    """A polygon (k, 3) moved up."""
    return polygon + np.array([0.0, 0.0, by])


class Town:
    """Builds and holds the faces, and for every solid its corners and half-spaces (normals, offsets)."""

    def __init__(self) -> None:
        self.rng = np.random.default_rng(SEED)
        self.grain = Grain(self.rng)
        self.faces: list[Face] = []
        self.trees: list[Tree] = []
        self.corners: list[FloatArray] = []
        self.half_spaces: list[tuple[FloatArray, FloatArray]] = []
        self.footprints: list[tuple[FloatArray, float, float, float]] = []
        self.add_ground()

    def add_ground(self, reach: float = 300.0) -> None:
        square = reach * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
        # coordinates are taken from the first corner; shifting it back makes them the world's
        self.faces.append(
            Face(square, lambda f, s, t: ground(f, s - reach, t - reach), Surface(self.grain, 1), "ground")
        )

    def add_solid(self, faces: list[tuple[FloatArray, Material, str]], eaves: float = 0.0) -> None:
        """A convex solid from its (corners, material, plane) faces."""
        built: list[Face] = []
        for corners, material, plane in faces:
            width = float(np.linalg.norm(corners[1] - corners[0]))
            surface = Surface(self.grain, len(self.faces) + len(built) + 2, width, eaves)
            built.append(Face(corners, material, surface, plane, len(self.corners)))
        self.faces += built
        self.corners.append(np.unique(np.concatenate([f.corners for f in built]).round(9), axis=0))
        normals = np.array([f.normal for f in built])
        self.half_spaces.append((normals, np.array([f.normal @ f.origin for f in built])))

    def add_prism(
        self, base: FloatArray, top: FloatArray, sides: Material, cap: Material, cap_plane: str = "",
        building: str = "", eaves: float = 0.0,
    ) -> None:  # fmt: skip
        """A hexahedron between two quadrilaterals (4, 3), counter-clockwise from above; listed by the names given."""
        faces = [(top, cap, cap_plane)]
        for k in range(4):
            n = (k + 1) % 4
            wall = np.array([base[k], base[n], top[n], top[k]])
            faces.append((wall, sides, building and f"{building} wall {k}"))
        faces.append((base[::-1], sides, ""))
        self.add_solid(faces, eaves)

    def add_box(self, frame: Frame, place: Place, size: Size, sides: Material, cap: Material) -> None:
        """A box of (length, width, height) standing at a point of a frame; its planes are not listed."""
        base = frame.rectangle(place[0], place[1], size[0], size[1], place[2])
        self.add_prism(base, raised(base, size[2]), sides, cap)

    def add_block(self, name: str, frame: Frame, size: Size, walls: Material, roof: Material, trim: Colour) -> None:
        """A flat-roofed building of (length, width, height) with a parapet and plant on the roof."""
        length, width, height = size
        base = frame.rectangle(0, 0, length, width, 0)
        self.add_prism(base, raised(base, height), walls, roof, f"{name} roof", name, height)
        self.footprints.append((frame.centre, frame.azimuth, length / 2, width / 2))
        rim, thick = 0.5, 0.35
        for sign in (-1, 1):
            self.add_box(frame, (0, sign * (width - thick) / 2, height), (length, thick, rim), paint(trim), paint(trim))
            ends = (thick, width - 2 * thick, rim)
            self.add_box(frame, (sign * (length - thick) / 2, 0, height), ends, paint(trim), paint(trim))
        side, lid = paint((0.3, 0.31, 0.32)), paint((0.40, 0.41, 0.42), 0.06, 0.06)
        plant: list[tuple[float, float, Size]]
        plant = [(-0.22, 0.15, (2.4, 1.8, 1.3)), (0.27, -0.2, (1.6, 1.6, 0.9)), (0.05, 0.22, (1.1, 0.9, 0.7))]
        for x, y, box in plant:
            self.add_box(frame, (x * length, y * width, height), box, side, lid)

    def add_house(self, name: str, frame: Frame, size: Size, rise: float, walls: Material, roof: Material) -> None:
        """A gabled house of (length, width, eaves height); the ridge runs along its length."""
        length, width, eaves = size
        base = frame.rectangle(0, 0, length, width, 0)
        wall_top = raised(base, eaves)
        ridge = frame.points([[-length / 2, 0, eaves + rise], [length / 2, 0, eaves + rise]])
        self.add_solid(
            [
                (np.array([base[0], base[1], wall_top[1], wall_top[0]]), walls, f"{name} wall 0"),
                (np.array([base[1], base[2], wall_top[2], ridge[1], wall_top[1]]), walls, f"{name} wall 1"),
                (np.array([base[2], base[3], wall_top[3], wall_top[2]]), walls, f"{name} wall 2"),
                (np.array([base[3], base[0], wall_top[0], ridge[0], wall_top[3]]), walls, f"{name} wall 3"),
                (np.array([wall_top[0], wall_top[1], ridge[1], ridge[0]]), walls, ""),
                (np.array([wall_top[2], wall_top[3], ridge[0], ridge[1]]), walls, ""),
            ],
            eaves,
        )
        self.footprints.append((frame.centre, frame.azimuth, length / 2, width / 2))
        self.add_roof(name, frame, size, rise, roof)
        foot = (0.22 * length, 0.14 * width, eaves + 0.45 * rise)
        self.add_box(frame, foot, (0.8, 0.6, 0.55 * rise + 0.9), facade(BRICK, BRICKS), paint((0.2, 0.19, 0.18)))

    def add_roof(self, name: str, frame: Frame, size: Size, rise: float, roof: Material) -> None:
        """Two slabs 0.2 m thick that overhang the walls by half a metre."""
        length, width, eaves = size
        a, b, gradient = length / 2 + 0.5, width / 2 + 0.5, 2 * rise / width
        edge = paint((0.33, 0.31, 0.28))
        for side, sign in enumerate((1, -1)):
            low, high = eaves + rise - gradient * b, eaves + rise
            under = frame.points(
                [[-sign * a, -sign * b, low], [sign * a, -sign * b, low], [sign * a, 0, high], [-sign * a, 0, high]]
            )
            self.add_prism(under, raised(under, 0.2), edge, roof, f"{name} roof {side}")

    def add_car(self, x: float, y: float, azimuth: float, colour: Colour) -> None:
        """Body and cabin, 4.4 m long; not listed in the truth."""
        frame = Frame(x, y, azimuth)
        lacquer, glass = paint(colour, 0.02, 0.03, 0.0), paint((0.03, 0.035, 0.04), 0.05, 0.05)
        self.add_box(frame, (0, 0, 0.28), (4.4, 1.8, 0.55), lacquer, lacquer)
        base, top = frame.rectangle(-0.2, 0, 2.7, 1.65, 0.83), frame.rectangle(-0.3, 0, 1.7, 1.4, 1.42)
        self.add_prism(base, top, glass, lacquer)

    def add_tree(self, x: float, y: float, radius: float, height: float, colour: Colour) -> None:
        """A crown of leaf balls on the surface of an ellipsoid, dense enough to hide what is inside."""
        count = int(45 + 40 * radius)
        directions = self.rng.standard_normal((count, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        shell = directions * self.rng.uniform(0.45, 0.95, (count, 1)) * [radius, radius, 0.8 * radius]
        radii = radius * self.rng.uniform(0.14, 0.3, count)
        surface = Surface(self.grain, len(self.trees) + 400)
        self.trees.append(Tree(shell + np.array([x, y, height]), radii, foliage(colour), surface))


@dataclass(frozen=True)
class Frame:
    """A place on the ground: x, y in metres, azimuth of its first axis from east towards north in degrees."""

    x: float
    y: float
    azimuth: float

    @property
    def centre(self) -> FloatArray:
        return np.array([self.x, self.y])

    def points(self, local: list[list[float]]) -> FloatArray:
        """World points (n, 3) of local ones (n, 3)."""
        c, s = np.cos(np.deg2rad(self.azimuth)), np.sin(np.deg2rad(self.azimuth))
        return np.array(local, dtype=float) @ [[c, s, 0], [-s, c, 0], [0, 0, 1]] + [self.x, self.y, 0]

    def rectangle(self, x: float, y: float, length: float, width: float, z: float) -> FloatArray:
        """Corners (4, 3) of a level rectangle, counter-clockwise from above."""
        a, b = length / 2, width / 2
        return self.points([[x - a, y - b, z], [x + a, y - b, z], [x + a, y + b, z], [x - a, y + b, z]])


def build_town() -> Town:
    """Two streets that cross, apartment blocks, houses, parked cars and trees."""
    town = Town()
    town.add_block("block A", Frame(-22, 16, 0), (17, 12, 11.6), facade(WHITE), flat_roof((0.24, 0.23, 0.22)), CONCRETE)
    town.add_block("block B", Frame(9, 33, 0), (15, 11, 8.6), facade(OCHRE), flat_roof((0.30, 0.28, 0.25)), WHITE)
    town.add_block(
        "shop", Frame(-20, -17, 0), (12, 9, 4.4), facade(BLUE_GREY, pitch=2.2), flat_roof((0.34, 0.33, 0.31)), WHITE
    )
    town.add_block(
        "block C", Frame(-24, 33, 0), (14, 11, 8.6), facade(SAND_BRICK, BRICKS), flat_roof((0.20, 0.2, 0.21)), CONCRETE
    )
    houses = [
        ("house 1", Frame(7, 8, 4), (10, 8, 5.6), 3.0, facade(BRICK, BRICKS), tiled_roof(RED_TILE)),
        ("house 2", Frame(21, 7, 90), (11, 8.5, 5.6), 3.6, facade(PLASTER), tiled_roof(SLATE, 0.34, 0.4)),
        ("house 3", Frame(7, 20, 94), (9, 7.5, 3.4), 2.7, facade(WHITE), tiled_roof(BROWN_TILE)),
        ("house 4", Frame(20, 21, -5), (11, 8, 5.6), 2.6, facade(SAND_BRICK, BRICKS), seamed_roof((0.30, 0.36, 0.36))),
        ("house 5", Frame(5, -19, 0), (9.5, 8, 5.6), 3.2, facade(OCHRE), tiled_roof(RED_TILE)),
        ("house 6", Frame(18, -18, 87), (10, 8, 3.4), 3.1, facade(BRICK, BRICKS), tiled_roof(SLATE, 0.34, 0.4)),
        ("house 7", Frame(33, 12, 90), (11, 8, 5.6), 3.0, facade(BLUE_GREY), tiled_roof(RED_TILE)),
        ("house 8", Frame(26, 35, 0), (12, 8, 5.6), 3.2, facade(BRICK, BRICKS), tiled_roof(BROWN_TILE)),
        ("house 9", Frame(-38, 14, 90), (10, 8, 5.6), 3.4, facade(PLASTER), tiled_roof(RED_TILE)),
    ]
    for name, frame, size, rise, walls, roof in houses:
        town.add_house(name, frame, size, rise, walls, roof)
    cars = [
        (-8.8, 9, 90, (0.42, 0.06, 0.04)), (-5.2, 24, 90, (0.5, 0.5, 0.5)), (14, -6.8, 0, (0.06, 0.10, 0.22)),
        (3, -3.3, 180, (0.03, 0.03, 0.035)), (-26, -6.7, 0, (0.45, 0.42, 0.36)), (-5.3, -17, 90, (0.10, 0.2, 0.12)),
    ]  # fmt: skip
    for car in cars:
        town.add_car(*car)
    green, olive = (0.075, 0.125, 0.03), (0.11, 0.13, 0.04)
    trees = [
        (0.6, 14, 1.7, 3.0, green), (14, 14.5, 2.1, 3.6, olive), (13.6, 3.4, 1.3, 2.2, green),
        (-11.6, 6.5, 1.6, 3.2, green), (0.8, 27, 2.0, 3.4, olive), (-12.5, -12, 1.9, 3.4, green),
        (11.5, -14, 1.7, 3.0, olive), (27, 15, 1.8, 3.1, green), (-12.6, 27, 1.8, 3.2, green),
        (27, 26, 2.0, 3.5, olive),
    ]  # fmt: skip
    for tree in trees:
        town.add_tree(*tree)
    return town
