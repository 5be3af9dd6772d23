"""The leg as the search for contact causes sees it: body and actuators as diagnosed, on a ground whose numbers vary."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import mujoco
import numpy as np

from ...actuators import Chain, Drivetrain
from ...envs.engine.scene import FLOOR
from ...envs.hopper.robot import HOPPER, LOWER
from .pieces import Grounded

MAX_SOFT_STIFFNESS = 1.5e4
"""[N/m] of a ground that the engine's step resolves; half a kilogram sinks a millimetre into it."""
GROUND_MASS = 0.01  # [kg] of the ground that moves with the foot where it is soft: assumed
IMMOBILE_MASS = 1e6  # [kg] of the ground where it is not
CONTACT_DEPTH = 3e-4  # [m] of a foot in the engine's own contact, whose stiffness grows with it: a leg at rest, about
GROUND_BODY, GROUND_JOINT = "ground", "ground_normal"
GROUND_SIZE = (20.0, 2.0, 0.05)  # [m] half sizes of the ground
GROUND = {
    "contact.friction": 1.0,  # coefficient of the foot on the ground
    "contact.time": 0.006,  # [s] time constant of the engine's contact itself
    "contact.stiffness": np.inf,  # [N/m] under the foot along the normal, that contact included
    "contact.damping": 20.0,  # [N.s/m] of ground that is not rigid
    "contact.slope": 0.0,  # [rad] positive where the ground rises along x
    "contact.height": 0.0,  # [m] of the ground where x is zero
}
"""Numbers of the ground by path, as they are unless the sidecar says otherwise."""
UNITS = dict(zip(GROUND, ("1", "s", "N/m", "N.s/m", "rad", "m"), strict=True))
NUMBERS = {"contact.friction": "floor_friction", "contact.time": "contact_time"}
"""Of these, the ones that are numbers of the robot's model."""


@dataclass(frozen=True, eq=False)
class LegModel(Grounded):
    """A hopper with its chains.

    Attributes:
        params: numbers of the robot, complete.
        chains: of its joints, as the diagnosis of each left them.
        hardness: stiffness of the engine's own contact times its time constant squared [N.s2/m].
        inverse_mass: of the foot, as the engine takes it for a contact [1/kg].
    """

    units: ClassVar[Mapping[str, str]] = UNITS

    params: Mapping[str, float]
    chains: Mapping[str, Chain]
    hardness: float = np.inf
    inverse_mass: float = 1.0

    @staticmethod
    def of(params: Mapping[str, float], chains: Mapping[str, Chain]) -> LegModel:
        """The leg that a sidecar describes.

        Raises:
            SealegsError: a number that the robot does not have or cannot take.
        """
        complete = HOPPER.parameters(params)
        ground = GROUND | {path: complete[name] for path, name in NUMBERS.items()}
        leg = LegModel(complete, chains, ground=ground)
        hardness, inverse_mass = _hardness(leg.drivetrain().model)
        leg = replace(leg, hardness=hardness, inverse_mass=inverse_mass)
        return leg.with_fitted({"contact.stiffness": leg.engine_stiffness()})

    def drivetrain(self) -> Drivetrain:
        """The leg in the engine, on ground that may slope and give way along its normal."""
        numbers = {name: self.value(path) for path, name in NUMBERS.items()}
        spec = HOPPER.build_spec({**self.params, **numbers})
        plane = spec.geom(FLOOR)
        solref, friction = np.array(plane.solref), np.array(plane.friction)
        spec.delete(plane)  # a plane cannot move
        stiffness, damping, mass = self.compliance(plain=True)
        half = -0.5 * self.value("contact.slope")  # about y, which points away from who has x to the right
        body = spec.worldbody.add_body(
            name=GROUND_BODY,
            pos=(0.0, 0.0, self.value("contact.height")),
            quat=(np.cos(half), 0.0, np.sin(half), 0.0),
            mass=mass,
            ipos=(0.0, 0.0, 0.0),
            inertia=(mass,) * 3,
            explicitinertial=True,
            gravcomp=1.0,
        )
        joint = body.add_joint(name=GROUND_JOINT, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0.0, 0.0, 1.0))
        joint.stiffness, joint.damping = [stiffness, 0.0, 0.0], [damping, 0.0, 0.0]
        body.add_geom(
            name=FLOOR, type=mujoco.mjtGeom.mjGEOM_BOX, size=GROUND_SIZE, pos=(0.0, 0.0, -GROUND_SIZE[2]),
            solref=solref, friction=friction, priority=1, mass=0.0,
        )  # fmt: skip
        return Drivetrain(spec, dict(self.chains), HOPPER.coordinates)

    def engine_stiffness(self, plain: bool = False) -> float:
        """Stiffness of the engine's own contact [N/m], which lies on top of any ground that gives way.

        Args:
            plain: where the engine takes the moving ground's mass for a part of the contact, which makes it softer. It
                always does, but in replays (:mod:`sealegs.gap.ground.leg_ground`) it is told not to.
        """
        stiffness = self.hardness / self.value("contact.time") ** 2
        return stiffness / (1.0 + 1.0 / (GROUND_MASS * self.inverse_mass)) if plain else stiffness

    def softest_rigid(self) -> float:
        """Stiffness under the foot [N/m] from which the engine's step does not resolve a ground beneath its contact."""
        return 1.0 / (1.0 / MAX_SOFT_STIFFNESS + 1.0 / self.engine_stiffness())

    def compliance(self, plain: bool = False) -> tuple[float, float, float]:
        """Stiffness [N/m], damping [N.s/m] and mass [kg] of what lies beneath the engine's contact.

        Both give way one after the other. A rigid ground is too heavy to move.

        Args:
            plain: see :meth:`engine_stiffness`.
        """
        whole = self.value("contact.stiffness")
        if whole > self.softest_rigid():
            return 0.0, 0.0, IMMOBILE_MASS
        beneath = 1.0 / whole - 1.0 / self.engine_stiffness(plain)
        return 1.0 / max(beneath, 1.0 / MAX_SOFT_STIFFNESS), self.value("contact.damping"), GROUND_MASS

    def mass_centre(self, hip: np.ndarray | float, knee: np.ndarray | float, split: bool = False) -> np.ndarray:
        """Height of the centre of mass over the hip [m] at link angles against the vertical [rad].

        Split into the parts of upper and lower link on request; :meth:`mass_centre_ahead` is their derivative by angle.
        """
        parts = -np.stack(np.broadcast_arrays(*(r * np.cos(q) for r, q in zip(self._arms(), (hip, knee), strict=True))))
        return parts if split else parts.sum(axis=0)

    def mass_centre_ahead(self, hip: np.ndarray | float, knee: np.ndarray | float, split: bool = False) -> np.ndarray:
        """How far the centre of mass is ahead of the hip [m]; see :meth:`mass_centre`, less its derivative by angle."""
        parts = np.stack(np.broadcast_arrays(*(r * np.sin(q) for r, q in zip(self._arms(), (hip, knee), strict=True))))
        return parts if split else parts.sum(axis=0)

    def _arms(self) -> tuple[float, float]:
        """Mass moments of upper and lower link over the total mass [m]."""
        p = self.params
        upper = (p["upper_mass"] * p["upper_centre"] + p["lower_mass"]) * p["upper_length"]
        return upper / p["total_mass"], p["lower_mass"] * p["lower_centre"] * p["lower_length"] / p["total_mass"]


def _hardness(model: mujoco.MjModel) -> tuple[float, float]:
    """Stiffness of the engine's contact at rest on ground that cannot move, at :data:`CONTACT_DEPTH`, times its time
    constant squared [N.s2/m], and the inverse mass of the foot in it [1/kg].

    Source: MuJoCo's documentation, "Computation", on the parameters of constraints.
    """
    floor = model.geom(FLOOR)
    _, ratio = floor.solref
    least, most, width, middle, power = floor.solimp
    x = min(CONTACT_DEPTH / width, 1.0)
    part = (
        x**power / middle ** (power - 1.0) if x < middle else 1.0 - (1.0 - x) ** power / (1.0 - middle) ** (power - 1)
    )
    impedance = least + part * (most - least)
    inverse_mass = float(model.body_invweight0[model.body(LOWER).id, 0])
    return float(impedance**2 / ((1.0 - impedance) * inverse_mass * (most * ratio) ** 2)), inverse_mass
