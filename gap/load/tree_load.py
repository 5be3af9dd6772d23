"""What hangs behind a joint of a robot as a load that a search may change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from .load import Load, Range


@dataclass(frozen=True)
class TreeLoad(Load):
    """What hangs behind a joint of a robot, as a change of what its model file says.

    ``extra_inertia`` is of the joint's own body about the joint's axis; of a slide, mass that gravity does not feel
    [kg]. ``centre_shift`` is of that body's centre of mass, ``typical_inertia`` is in the middle of the log. Its masses
    were weighed or computed by somebody, and the file says its pose; how it moves depends on the other joints.

    Attributes:
        payload: at the end of the robot, believed to carry nothing [kg].
        rotor_inertia: inertia beyond the chain's, of what turns only as the joint does against its parent, as a rotor
            behind a gear [kg.m2].
        typical_gravity: largest change of the torque with the angle [N.m/rad].
        carried: whether joints above turned the joint's own body about the joint's axis in the log.
    """

    mass_keys: ClassVar[tuple[str, ...]] = ("mass_factor", "payload")
    tunable: ClassVar[tuple[str, ...]] = ("mass_factor",)
    predictable: ClassVar[bool] = False
    pose_known: ClassVar[bool] = True

    payload: float = 0.0
    rotor_inertia: float = 0.0
    typical_gravity: float = 0.0
    carried: bool = False

    @property
    def pull_back(self) -> float:
        """As it was along the log."""
        return self.typical_gravity * self.mass_factor

    def known(self, params: Mapping[str, float]) -> bool:
        """Whether the load is known; it is, or there would be none of these."""
        del params
        return True

    def inertia(self, params: Mapping[str, float]) -> float:
        """Typical inertia about the joint [kg.m2]."""
        del params
        return self.typical_inertia * self.mass_factor + self.extra_inertia + self.rotor_inertia

    def gravity_torque(self, params: Mapping[str, float]) -> float:
        """Largest torque of gravity [N.m]."""
        del params
        return self.typical_gravity * self.mass_factor

    def planned_gravity(self, params: Mapping[str, float]) -> float:
        """None: a planned motion of a robot goes where it went before [N.m]."""
        del params
        return 0.0

    def stop_ranges(self, middle: float, half: float, start: float) -> tuple[Range, Range]:
        """About the middle of its motion, which need not be at zero; what it reached is less than it would have."""
        away = 1.05 * start * half
        upper = Range(middle - 0.25 * half, middle + 2.0 * half, middle + away, 0.03)
        return upper, Range(middle - 2.0 * half, middle + 0.25 * half, middle - away, 0.03)

    def inertia_ranges(self, armature: float) -> dict[str, Range]:
        """Down to a tenth of file and chain [kg.m2]. Where nothing above turns the link, a rotor is the same.

        The rotor comes first: nobody states it, where a link's inertia is reckoned from its shape.
        """
        whole = self.typical_inertia + armature
        link = {"extra_inertia": Range(-0.9 * self.typical_inertia, 20.0 * whole, 0.1 * whole, 0.1 * whole)}
        rotor = {"rotor_inertia": Range(-0.9 * armature, 20.0 * whole, 0.1 * whole, 0.1 * whole)}
        return {**rotor, **link} if self.carried else link

    def unknown_ranges(self, armature: float) -> dict[str, Range]:
        """About what the file gives: what hangs behind the joint by a factor, and more inertia."""
        whole = self.inertia({}) + armature
        more = Range(-0.9 * self.inertia({}), 20.0 * whole, 0.0, 0.1 * whole)
        return {"mass_factor": Range(0.05, 20.0, 1.0, 0.3), "extra_inertia": more}

    def along_log(self, slide: bool) -> dict[str, float]:
        """What a fit changes of the terms."""
        return {
            "inertia": self.rotor_inertia + (self.extra_inertia if slide else 0.0),
            "spin": 0.0 if slide else self.extra_inertia,
            "gravity": 0.0,
            "tree": 2.0 if slide else 1.0,
            "mass": self.mass_factor,
            "payload": self.payload,
            "shift": self.centre_shift,
        }
