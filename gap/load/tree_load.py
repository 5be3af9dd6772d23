"""What hangs behind a joint of a robot as a load that a search may change."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

from .load import Range


@dataclass(frozen=True)
class TreeLoad:
    """What hangs behind a joint of a robot, as a change of what its model file says.

    Attributes:
        mass_factor: true over believed mass of all that hangs behind the joint.
        payload: at the end of the robot, believed to carry nothing [kg].
        extra_inertia: of the joint's own body about the joint's axis, beyond that of the file [kg.m2]; of a slide, mass
            that gravity does not feel [kg].
        rotor_inertia: the same of what turns only as the joint does against its parent, as a rotor behind a gear.
        centre_shift: of the joint's own body's centre of mass, away from the joint [m].
        stop_angle, lower_stop: beyond and below which something blocks the link [rad].
        stop_stiffness: of what blocks it [N.m/rad]; 0: as usual of such a joint.
        typical_inertia: in the middle of the log [kg.m2].
        typical_gravity: largest change of the torque with the angle [N.m/rad].
        least_payload: the least that leaves a body at the end of the robot [kg], below zero.
        own_lever: of the joint's own body where others hang behind it, from the joint to its centre of mass [m]; 0
            where nothing does: then one factor is all that its mass may be wrong by.
        tip_mass: what would weigh as much at the end of the robot as the last of those bodies does [kg]; 0 where
            there is none.
        carried: whether joints above turned the joint's own body about the joint's axis in the log.
    """

    mass_factor: float = 1.0
    payload: float = 0.0
    extra_inertia: float = 0.0
    rotor_inertia: float = 0.0
    centre_shift: float = 0.0
    stop_angle: float = math.inf
    lower_stop: float = -math.inf
    stop_stiffness: float = 0.0
    typical_inertia: float = 0.0
    typical_gravity: float = 0.0
    least_payload: float = 0.0
    own_lever: float = 0.0
    tip_mass: float = 0.0
    carried: bool = False

    @property
    def mass_keys(self) -> tuple[str, ...]:
        """All that hangs behind the joint, or something at the end of it."""
        return ("mass_factor", "payload")

    @property
    def tunable(self) -> tuple[str, ...]:
        """Masses of bodies that somebody weighed or computed."""
        return ("mass_factor",)

    @property
    def pull_back(self) -> float:
        """As it was along the log."""
        return self.typical_gravity * self.mass_factor

    @property
    def predictable(self) -> bool:
        """It depends on how the other joints move."""
        return False

    @property
    def pose_known(self) -> bool:
        """The model file says it."""
        return True

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

    def stops(self, params: Mapping[str, float]) -> tuple[float, float]:
        """Angles below and beyond which something blocks the link [rad]."""
        del params
        return self.lower_stop, self.stop_angle

    def numbers(self, params: Mapping[str, float]) -> dict[str, float]:
        """Numbers of a bench with this load: none, a robot's stand in its model file."""
        return dict(params)

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

    def value(self, key: str) -> float:
        """A number that a fit may turn."""
        return getattr(self, key)

    def with_values(self, values: Mapping[str, float]) -> TreeLoad:
        """The load with some of these numbers set."""
        return dataclasses.replace(self, **values)
