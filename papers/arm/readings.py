"""Readings of what the paper (paper 002) leaves open, and what its final model does under each of them.

Section 5.3 reports that the simulated tool goes "entirely different" ways and its z "in the opposite direction". Three
readings of the printed text do that, each on its own:

- "All damping coefficients are motor referred" (3.1): behind gears of ratio N, c_r counts N squared at the joint.
  Table IV's gears of joint 1 have N = 18.99. Gears of joints 2 and 3 are not printed.
- Tables XI and XII hold the axes of the final model, which lean about 1 degree against those of table I, for which
  the torques are computed.
- "The driving torques are obtained using the robotics methodology" (4), whose links are those of table II. The arm
  that they drive has those of table VIII.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...envs.arm.parameters import without_rotors
from ...envs.arm.tables import DAMPING, GEARS, JOINTS, TOOL
from ...envs.arm.trajectory import Line
from .axes import TABLE_I, Axes, printed_axes, simple_axes
from .dynamics import NONE, Joints, Motion, Three, ideal_torques, open_loop

LATE = 0.75  # share of the time after which the vertical motion is compared: the wanted one still rises
PLAIN = "plain"
"""The first reading that was built, and the only one that was not sought because the paper says that z falls."""
FALL = 1.0  # [mm] the paper's own mark (5.1): a fall beyond it counts
ORDER = "c_r1 > c_r3 > c_r2"  # of the dampers by their effect, as 5.2 has it
LIKE = 0.05  # of the tool's way: motions that are alike, assumed


def gear_ratio() -> float:
    """Turns of the motor per turn of joint 1, by the diameters of table IV; the worm gear's ratio is not printed."""
    return GEARS[1].diameter / GEARS[0].diameter * GEARS[3].diameter / GEARS[2].diameter


def referred(joints: int) -> Three:
    """c_r of table X at the joints, motor referred in the first so many joints with joint 1's gears [N.m.s/rad]."""
    first, second, third = (gear_ratio() ** 2 * c if k < joints else c for k, c in enumerate(DAMPING))
    return (first, second, third)


@dataclass(frozen=True)
class Reading:
    """One reading of the final model.

    Attributes:
        text: what is read how.
        damping: c_r at the joints [N.m.s/rad].
        axes: of the joints.
        links: numbers of the arm; None: tables VIII and IX.
        believed: numbers of the robot that the torques are computed for, on ``believed_axes``.
        believed_axes: those of the same robot.
        rests: names of the choices that it makes.
    """

    text: str
    damping: Three = DAMPING
    axes: Axes = TABLE_I
    links: Mapping[str, float] | None = None
    believed: Mapping[str, float] | None = None
    believed_axes: Axes = TABLE_I
    rests: tuple[str, ...] = ()


def readings() -> dict[str, Reading]:
    """All readings, by a short name."""
    simple, axes = without_rotors(), printed_axes()
    place = ("tool on the axes of tables XI and XII",)
    return {
        PLAIN: Reading("c_r at the joints, axes of table I, torques of table VIII's links"),
        "motor 1": Reading("c_r1 motor referred through table IV's gears", referred(1)),
        "motor": Reading("all c_r motor referred, through joint 1's gears", referred(3), rests=("other gears",)),
        "axes": Reading("axes of tables XI and XII", axes=axes, rests=place),
        "torques": Reading("torques of table II's links", believed=simple),
        "axes, motor": Reading(
            "axes of tables XI and XII, all c_r motor referred", referred(3), axes, rests=(*place, "other gears")
        ),
        "all": Reading(
            "all three at once", referred(3), axes, believed=simple, rests=(*place, "other gears")
        ),
        "own axes": Reading(
            "axes of tables XI and XII, torques computed on them", axes=axes, believed_axes=axes, rests=place
        ),
        "simple": Reading(
            "the model without rotors on tables V and VI, points on the first bodies", NONE, simple_axes("first"),
            simple, simple, rests=place,
        ),
        "simple, second": Reading(
            "the same, points on the second bodies", NONE, simple_axes("second"), simple, simple, rests=place
        ),
    }  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What the arm does under a reading.

    Attributes:
        reading: that it is of.
        motion: of the arm.
        perfect: of the same arm without dampers.
        alone: largest way of the tool from ``perfect`` with one damper alone, by joint [mm].
    """

    reading: Reading
    motion: Motion
    perfect: Motion
    alone: dict[str, float]

    @property
    def by_dampers(self) -> float:
        """Largest way of the tool that the dampers make [mm]."""
        return apart(self.motion, self.perfect)

    @property
    def way(self) -> float:
        """Between the tool's first and last place [mm]."""
        return 1e3 * float(np.linalg.norm(np.subtract(TOOL[1], TOOL[0])))

    @property
    def like(self) -> bool:
        """Whether the tool moves like that of the ideal arm."""
        return self.motion.largest < LIKE * self.way

    @property
    def major(self) -> bool:
        """Whether the dampers' effect is larger than that of all else."""
        return self.by_dampers > self.perfect.largest

    @property
    def order(self) -> str:
        """The joints' dampers by their effect, such as ``c_r3 > c_r1 > c_r2``."""
        if not any(self.reading.damping):
            return "none"
        names = sorted(self.alone, key=lambda name: -self.alone[name])
        return " > ".join(f"c_r{JOINTS.index(name) + 1}" for name in names)

    @property
    def opposite(self) -> bool:
        """Whether z falls where it should rise."""
        return fall(self.motion)[0] > FALL


def outcome(reading: Reading) -> Outcome:
    """The arm under a reading; springs of table X, which move the tool by 0.002 mm, are left out."""
    alone = [tuple(value if k == joint else 0.0 for k, value in enumerate(reading.damping)) for joint in range(3)]
    cases = [Joints(reading.damping), Joints(), *(Joints((a, b, c)) for a, b, c in alone)]
    torques = ideal_torques(Line(), reading.believed, reading.believed_axes)
    motion, perfect, *single = open_loop(cases, params=reading.links, torques=torques, axes=reading.axes)
    effects = {name: apart(item, perfect) for name, item in zip(JOINTS, single, strict=True)}
    return Outcome(reading, motion, perfect, effects)


def apart(first: Motion, second: Motion) -> float:
    """Largest distance between the tools of two motions [mm]."""
    return 1e3 * float(np.linalg.norm(first.tool - second.tool, axis=1).max())


def late_rise(motion: Motion) -> tuple[float, float]:
    """How far the tool rises in the last quarter of the time, and how far it should [mm]."""
    start = int(LATE * (len(motion.time) - 1))
    found, wanted = (1e3 * float(place[-1, 2] - place[start, 2]) for place in (motion.tool, motion.wanted))
    return found, wanted


def fall(motion: Motion) -> tuple[float, float]:
    """By how much z falls at most below where it was before [mm], and from when on [s]; it should rise all the time."""
    height = motion.tool[:, 2]
    below = np.maximum.accumulate(height) - height
    lowest = int(below.argmax())
    return 1e3 * float(below[lowest]), float(motion.time[int(height[: lowest + 1].argmax())])


def summary(found: Outcome) -> dict[str, Any]:
    """What the final model does under a reading: deviations [mm], and what follows from it."""
    return {
        "reading": found.reading.text,
        "largest": found.motion.largest,
        "perfect": found.perfect.largest,
        "dampers": found.by_dampers,
        "falls": fall(found.motion)[0],
        "late": late_rise(found.motion)[0],
        "opposite": "yes" if found.opposite else "no",
        "major": "yes" if found.major else "no",
        "order": found.order,
    }


def statements(outcomes: Mapping[str, Outcome]) -> dict[str, str]:
    """Names of the readings from which each statement of the text follows."""
    follows: dict[str, Callable[[Outcome], bool]] = {
        "opposite": lambda found: found.opposite,
        "major": lambda found: found.major,
        "order": lambda found: found.order == ORDER,
        "like": lambda found: found.like,
    }
    return {
        name: ", ".join(f"`{key}`" for key, found in outcomes.items() if holds(found))
        for name, holds in follows.items()
    }


def reading_lines(outcomes: Mapping[str, Outcome]) -> list[str]:
    """What the final model does under each reading, and which statements follow from it."""
    lines = [
        f"tool [mm] by reading of the final model; joint 1's gears have {gear_ratio():.2f}, squared "
        f"{gear_ratio() ** 2:.0f}",
        f"{'':15}{'misses':>8}{'perfect':>8}{'dampers':>8}{'z falls':>8}{'z late':>7}  {'opposite':9}"
        f"{'dampers major':14}order of dampers",
    ]
    for name, outcome in outcomes.items():
        o = summary(outcome)
        lines.append(
            f"{name:15}{o['largest']:8.1f}{o['perfect']:8.1f}{o['dampers']:8.1f}{o['falls']:8.1f}"
            f"{o['late']:+7.1f}  {o['opposite']:9}{o['major']:14}{o['order']}"
        )
    return [*lines, *(f"  {name}: {item.reading.text}" for name, item in outcomes.items()), ""]
