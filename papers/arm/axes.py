"""The axes of the joints, of which the paper (paper 002) prints three sets: table I, tables V to VII, and XI to XIII.

Tables V and VI, and XI and XII, hold two points of each axis on both bodies that it joins, in the bodies' frames at
their centres of mass (tables III and IX). Tables VII and XIII hold the axes of the torques.

- Table XII prints Z of joint 2 on link 1 as 00.0576; the points of both bodies only meet at -0.0576 m, which is taken.
- Where the tool is on the last link is not printed but for table I: (0.58, 0, 0.577) m at zero angles is taken.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from ...envs.arm.tables import FLEXIBLE, SIMPLE, TOOL, Body

Point = tuple[float, float, float]
GROUND = Body(0.0, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
SIDES = ("first", "second")


@dataclass(frozen=True)
class Hinge:
    """An axis between two bodies: two points of it on each, in the frames of both [m].

    Attributes:
        first, second: names of the bodies, which the tables call i and j.
        on_first, on_second: the points.
    """

    first: str
    second: str
    on_first: tuple[Point, Point]
    on_second: tuple[Point, Point]


SIMPLE_HINGES = (
    Hinge("ground", "link1", ((0, 0, 0), (0, 0, 1)), ((0.0185, -0.376, -0.043), (0.0185, 0, -0.043))),
    Hinge("link1", "link2", ((0.0189, 0.2007, -0.00528), (0.0189, 0.2007, 1)), ((0, 0, 0), (0, -1, 0))),
    Hinge("link2", "link3", ((0.29, 0, 0), (0.29, 0, 1)), ((-0.109, 0, 0), (-0.109, 0, 1))),
)
"""Tables V and VI, for the bodies of tables II and III."""

HINGES = (
    Hinge("ground", "rotor1", ((5e-5, 1.03e-3, 2.99e-3), (2.25e-3, 3.15e-3, 0.190)),
          ((-7.2e-4, -0.0617, 7e-4), (1.48e-3, 0.1253, -1.42e-3))),
    Hinge("rotor1", "link1", ((1.48e-3, 0.1253, -1.42e-3), (5.7e-4, 4.83e-2, -5.5e-4)),
          ((-2.53e-3, -0.2814, -0.0585), (-3.44e-3, -0.3584, -0.0576))),
    Hinge("link1", "rotor2", ((-7.9e-4, 0.1081, 0.1591), (6.1e-4, 0.1068, 0.0491)),
          ((-7.9e-4, -0.0617, 7.1e-4), (6.1e-4, 0.0483, -5.5e-4))),
    Hinge("rotor2", "link2", ((1.58e-3, 0.1253, -1.44e-3), (6.1e-4, 4.83e-2, -5.5e-4)),
          ((-2.82e-3, -0.0377, -5.9e-3), (-0.0038, -0.1148, -5e-3))),
    Hinge("link2", "rotor3", ((0.2892, -2.0e-3, 0.1223), (0.2882, -2.9e-3, 0.0423)),
          ((1.06e-3, 1.03e-3, 9.05e-2), (1.2e-4, 1.2e-4, 0.0105))),
    Hinge("rotor3", "link3", ((-1.9e-4, -1.8e-4, -0.0155), (1.2e-4, 1.2e-4, 0.0105)),
          ((-0.1078, 3.59e-3, 2.84e-2), (-0.1075, 3.88e-3, 0.05441))),
)  # fmt: skip
"""Tables XI and XII, for the bodies of tables VIII and IX."""

SIMPLE_TORQUES: tuple[tuple[Point, Point], ...] = (
    ((0, 0, 0), (0, 0, 1)),
    ((0.0189, 0.2007, -0.00528), (0.0189, 0.207, 1)),
    ((0.29, 0, 0), (0.29, 0, 1)),
)
"""Table VII: axes of the torques on the first bodies of :data:`SIMPLE_HINGES` [m]."""
TORQUES: tuple[tuple[Point, Point], ...] = (
    ((5e-5, 1.03e-3, 2.99e-3), (2.25e-3, 3.15e-3, 0.190)),
    ((1.48e-3, 0.1253, -1.42e-3), (5.7e-4, 4.83e-2, -5.5e-4)),
    ((-7.9e-4, 0.1081, 0.1591), (6.1e-4, 0.1068, 0.0491)),
    ((1.58e-3, 0.1253, -1.44e-3), (6.1e-4, 4.83e-2, -5.5e-4)),
    ((0.2892, -2.0e-3, 0.1223), (0.2882, -2.9e-3, 0.0423)),
    ((-1.9e-4, -1.8e-4, -0.0155), (1.2e-4, 1.2e-4, 0.0105)),
)
"""Table XIII: the same for :data:`HINGES`."""


@dataclass(frozen=True)
class Axis:
    """A line on which a joint turns, at zero angles.

    Attributes:
        point: on it, over the ground [m].
        direction: unit vector, about which angles count.
    """

    point: Point
    direction: Point


@dataclass(frozen=True)
class Axes:
    """The axes of the three joints.

    Attributes:
        joints: from the stand on.
        tool: at zero angles [m].
    """

    joints: tuple[Axis, Axis, Axis]
    tool: Point = TOOL[0]

    def place(self, angles: np.ndarray) -> np.ndarray:
        """Where the tool is (..., 3) [m] at joint angles (..., 3) [rad]: turned about one axis after the other."""
        place = np.broadcast_to(np.array(self.tool), angles.shape)
        for k in (2, 1, 0):
            point, axis = np.array(self.joints[k].point), np.array(self.joints[k].direction)
            arm, angle = place - point, angles[..., k : k + 1]
            along = (arm @ axis)[..., None] * axis
            place = point + along + (arm - along) * np.cos(angle) + np.cross(axis, arm) * np.sin(angle)
        return place


TABLE_I = Axes(
    (
        Axis((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        Axis((0.0, 0.0, 0.577), (0.0, -1.0, 0.0)),
        Axis((0.29, 0.0, 0.577), (0.0, 0.0, 1.0)),
    )
)


def on_ground(body: Body, point: Point) -> np.ndarray:
    """A point of a body's frame over the ground (3,) [m], at zero angles."""
    return np.array(body.centre) + body.turn @ np.array(point)


def ends(hinge: Hinge, bodies: Mapping[str, Body], side: str) -> np.ndarray:
    """Both points of a hinge on its ``first`` or ``second`` body, over the ground (2, 3) [m]."""
    name, points = (hinge.first, hinge.on_first) if side == "first" else (hinge.second, hinge.on_second)
    body = GROUND if name == "ground" else bodies[name]
    return np.array([on_ground(body, point) for point in points])


def gap(hinge: Hinge, bodies: Mapping[str, Body]) -> float:
    """How far the points on the second body are from the axis on the first, at most [m]."""
    start, end = ends(hinge, bodies, "first")
    return max(distance(start, end - start, point) for point in ends(hinge, bodies, "second"))


def distance(start: np.ndarray, along: np.ndarray, point: np.ndarray) -> float:
    """Of a point from a line [m]."""
    return float(np.linalg.norm(np.cross(point - start, along)) / np.linalg.norm(along))


def tilt(first: np.ndarray, second: np.ndarray) -> float:
    """Angle between two lines [deg]."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(first, second)), abs(first @ second))))


def line_through(points: np.ndarray, like: Axis) -> Axis:
    """The line nearest to points (n, 3) [m], which counts angles as ``like`` does."""
    middle = points.mean(axis=0)
    direction = np.linalg.svd(points - middle)[2][0]
    direction = direction * np.sign(direction @ np.array(like.direction))
    return Axis(_point(middle), _point(direction))


@cache
def printed_axes() -> Axes:
    """The axes of tables XI and XII: through the points on the first bodies of both hinges of a rotor."""
    found = []
    for k, like in enumerate(TABLE_I.joints):
        points = np.concatenate([ends(hinge, FLEXIBLE, "first") for hinge in HINGES[2 * k : 2 * k + 2]])
        found.append(line_through(points, like))
    return Axes((found[0], found[1], found[2]))


@cache
def simple_axes(side: str) -> Axes:
    """The axes of tables V and VI, by the points on the first or on the second bodies, which do not meet."""
    found = [
        line_through(ends(hinge, SIMPLE, side), like) for hinge, like in zip(SIMPLE_HINGES, TABLE_I.joints, strict=True)
    ]
    return Axes((found[0], found[1], found[2]))


def beside_table_one(axes: Axes) -> tuple[float, float]:
    """How far axes lean from those of table I at most [deg], and how far they lie beside them [mm].

    The second is measured where table I has the beginning of the next link, or the tool's height.
    """
    lean = max(tilt(np.array(a.direction), np.array(b.direction))
               for a, b in zip(axes.joints, TABLE_I.joints, strict=True))  # fmt: skip
    where = (TABLE_I.joints[1].point, TABLE_I.joints[1].point, TABLE_I.joints[2].point)
    aside = max(distance(np.array(a.point), np.array(a.direction), np.array(point))
                for a, point in zip(axes.joints, where, strict=True))  # fmt: skip
    return lean, 1e3 * aside


def _point(values: np.ndarray) -> Point:
    x, y, z = (float(value) for value in values)
    return (x, y, z)
