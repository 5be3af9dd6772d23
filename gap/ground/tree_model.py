"""Any robot whose base moves, as the search for contact causes sees it: its chains as diagnosed, on a varying ground.

How soft its feet meet the floor is one stiffness of the engine's contact, that of a spring under a foot, and a damping
ratio. MuJoCo's documentation, "Computation", on the parameters of constraints, tells how they hang together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from ...actuators import Chain, Drivetrain
from ...actuators.mounting import ENGINE_DEFAULTS
from ...common.errors import SealegsError
from ...envs.engine.base import BaseLayout
from ...envs.engine.robot import Robot
from .pieces import Grounded

BASE = "base"  # a free joint that has no name
GROUND_BODY, FLOOR = "ground", "floor"
FLOOR_SIZE = (0.0, 0.0, 0.05)  # without end
FLOOR_FRICTIONS = (0.005, 1e-4)  # about its normal, and of rolling
UNITS = {
    "contact.friction": "1",
    "contact.time": "s",
    "contact.stiffness": "N/m",
    "contact.damping_ratio": "1",
    "contact.slope": "rad",
    "contact.slope_y": "rad",
    "contact.height": "m",
}
"""Numbers of the ground by path. It rises along x by its slope, and along y by the other one."""
PLANE, HEIGHTS = int(mujoco.mjtGeom.mjGEOM_PLANE), int(mujoco.mjtGeom.mjGEOM_HFIELD)


@dataclass(frozen=True, eq=False)
class Contact:
    """How a robot's feet meet its floor, as its model file has it.

    Attributes:
        friction: coefficient.
        time: constant of the contact [s].
        ratio: its damping ratio.
        solimp: its impedance (5,).
        inverse_mass: of a foot, as the engine takes it [1/kg].
        condim: kinds of friction that act.
    """

    friction: float
    time: float
    ratio: float
    solimp: np.ndarray
    inverse_mass: float
    condim: int

    @property
    def impedance(self) -> float:
        """At half the depth over which it changes."""
        return float(0.5 * (self.solimp[0] + self.solimp[1]))

    @property
    def stiffness(self) -> float:
        """Under a foot at rest [N/m]."""
        d, most = self.impedance, float(self.solimp[1])
        return d**2 / ((1.0 - d) * self.inverse_mass * (most * self.time * self.ratio) ** 2)

    def solref(self, stiffness: float, ratio: float) -> np.ndarray:
        """What makes the engine's contact a spring of this size, damped by this ratio, in its direct format (2,)."""
        d, most = self.impedance, float(self.solimp[1])
        per_second = stiffness * (1.0 - d) * self.inverse_mass * (most / d) ** 2
        return -np.array([per_second, 2.0 * ratio * np.sqrt(per_second)])


@dataclass(frozen=True, eq=False)
class TreeModel(Grounded):
    """A robot with its chains, on a ground.

    Attributes:
        robot: without them.
        params: its numbers, complete.
        chains: of its coordinates, as the diagnosis of each left them.
        contact: of feet and floor as the model file has it.
        pivot: where the ground's height is told and its slopes turn it (2,) [m].
    """

    units: ClassVar[Mapping[str, str]] = UNITS

    robot: Robot
    params: Mapping[str, float]
    chains: Mapping[str, Chain]
    contact: Contact
    pivot: tuple[float, float]

    @staticmethod
    def of(
        robot: Robot, params: Mapping[str, float], chains: Mapping[str, Chain], pivot: tuple[float, float]
    ) -> TreeModel:
        """The robot that a sidecar describes.

        Raises:
            SealegsError: a number that it does not have, or a ground that is no floor.
        """
        complete = robot.parameters(params)
        contact = _contact(_built(robot, complete, chains).model)
        ground = {
            "contact.friction": contact.friction,
            "contact.time": contact.time,
            "contact.stiffness": contact.stiffness,
            "contact.damping_ratio": contact.ratio,
            "contact.slope": 0.0,
            "contact.slope_y": 0.0,
            "contact.height": 0.0,
        }
        return TreeModel(robot, complete, chains, contact, pivot, ground=ground)

    def drivetrain(self) -> Drivetrain:
        """The robot in the engine, on its ground."""
        drivetrain = _built(self.robot, self.params, self.chains)
        spec, model, friction = drivetrain.spec, drivetrain.model, self.value("contact.friction")
        body = spec.body(GROUND_BODY)
        (geom,) = body.geoms
        geom.friction, geom.solref = (friction, *FLOOR_FRICTIONS), self.solref()
        body.pos, body.quat = self.place()
        floor, ground = ground_of(model)
        model.geom_friction[floor, 0], model.geom_solref[floor] = friction, self.solref()
        model.body_pos[ground], model.body_quat[ground] = self.place()
        return drivetrain

    def solref(self) -> np.ndarray:
        """Of the contact, in the engine's direct format (2,): a shorter time constant makes it harder."""
        turned = self.contact.time / self.value("contact.time")
        return self.contact.solref(self.value("contact.stiffness") * turned**2, self.value("contact.damping_ratio"))

    def place(self) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) [m] and orientation (4,) of the ground."""
        along, across = self.value("contact.slope"), self.value("contact.slope_y")
        about_y = np.array([np.cos(0.5 * along), 0.0, -np.sin(0.5 * along), 0.0])
        about_x = np.array([np.cos(0.5 * across), np.sin(0.5 * across), 0.0, 0.0])
        turned = np.zeros(4)
        mujoco.mju_mulQuat(turned, about_x, about_y)
        return np.array([*self.pivot, self.value("contact.height")]), turned


def ground_of(model: mujoco.MjModel) -> tuple[int, int]:
    """Numbers of the floor's geom and of its body."""
    body = int(model.body(GROUND_BODY).id)
    return int(model.body_geomadr[body]), body


def base_joints(robot: Robot, model: mujoco.MjModel) -> list[int]:
    """Numbers of the joints by which the base of a robot moves: those that carry all that it drives; none if fixed."""
    driven = {joint for item in robot.coordinates for joint, _ in item.terms}
    bodies = [int(model.joint(name).bodyid[0]) for name in driven]
    common = set(_chain_to_world(model, bodies[0])).intersection(*(_chain_to_world(model, body) for body in bodies))
    found = [j for j in range(model.njnt) if int(model.jnt_bodyid[j]) in common and model.joint(j).name not in driven]
    behind = [j for j in range(model.njnt) if int(model.jnt_bodyid[j]) in common and model.joint(j).name in driven]
    first = min(behind, default=model.njnt)
    return [j for j in found if j < first]


def base_layout(robot: Robot, drivetrain: Drivetrain) -> BaseLayout:
    """The quantities by which the base of a robot moves."""
    model = drivetrain.model
    return BaseLayout.of_model(model, base_joints(robot, model))


def _chain_to_world(model: mujoco.MjModel, body: int) -> list[int]:
    found = []
    while body > 0:
        found.append(body)
        body = int(model.body_parentid[body])
    return found


def _built(robot: Robot, params: Mapping[str, float], chains: Mapping[str, Chain]) -> Drivetrain:
    """The robot with its floor on a body of its own, whose friction and softness count whatever meets it.

    Raises:
        SealegsError: it stands on several planes, or on a height field.
    """
    spec = robot.build(params)
    for joint in spec.joints:
        if joint.type == mujoco.mjtJoint.mjJNT_FREE and not joint.name:
            joint.name = BASE
    planes = [geom for geom in spec.worldbody.geoms if int(geom.type) == PLANE]
    if len(planes) > 1 or any(int(geom.type) == HEIGHTS for geom in spec.worldbody.geoms):
        raise SealegsError(
            f"robot '{robot.name}': its model has {'several planes' if len(planes) > 1 else 'a height field'}, and one "
            "floor is what can be judged; leave one plane in it."
        )
    # default classes are of the parts of the file, and a floor of ours is none of them
    of_ours = {"default": ENGINE_DEFAULTS, "type": mujoco.mjtGeom.mjGEOM_PLANE, "size": FLOOR_SIZE}
    plane = planes[0] if planes else spec.worldbody.add_geom(name=FLOOR, **of_ours)
    contact, name, height = _contact(spec.copy().compile()), plane.name or FLOOR, float(plane.pos[2])
    kind, affinity = int(plane.contype), int(plane.conaffinity)
    margin, gap = float(plane.margin), float(plane.gap)
    spec.delete(plane)
    body = spec.worldbody.add_body(name=GROUND_BODY, pos=(0.0, 0.0, height))
    floor = body.add_geom(name=name, contype=kind, conaffinity=affinity, margin=margin, gap=gap, **of_ours)
    floor.priority = 1 + max((int(geom.priority) for geom in spec.geoms), default=0)
    floor.solimp, floor.condim, floor.solref = contact.solimp, contact.condim, (contact.time, contact.ratio)
    floor.friction = (contact.friction, *FLOOR_FRICTIONS)
    drivetrain = Drivetrain(spec, dict(chains), robot.coordinates)
    robot.finish(drivetrain, params)
    return drivetrain


def _contact(model: mujoco.MjModel) -> Contact:
    """How feet meet the floor: the engine's rules for two geoms that touch."""
    planes = [k for k in range(model.ngeom) if int(model.geom_type[k]) == PLANE]
    floor = next(k for k in planes if int(model.body_weldid[model.geom_bodyid[k]]) == 0)
    feet = _feet(model, floor)
    if not feet:
        raise SealegsError("nothing of the robot can touch its floor; let the geoms of its feet collide with it.")
    foot = feet[0]
    higher = int(model.geom_priority[floor]) - int(model.geom_priority[foot])
    if higher:
        ruler = floor if higher > 0 else foot
        friction, condim = float(model.geom_friction[ruler, 0]), int(model.geom_condim[ruler])
        solref, solimp = model.geom_solref[ruler], model.geom_solimp[ruler]
    else:
        friction = float(max(model.geom_friction[floor, 0], model.geom_friction[feet, 0].max()))
        condim = int(max(model.geom_condim[floor], model.geom_condim[foot]))
        solref = 0.5 * (model.geom_solref[floor] + model.geom_solref[foot])
        solimp = 0.5 * (model.geom_solimp[floor] + model.geom_solimp[foot])
    time, ratio = (float(value) for value in solref)
    if time < 0.0:  # the direct format: stiffness and damping
        stiffness, damping = -time, max(-ratio, 1e-9)
        time, ratio = 2.0 / damping, 0.5 * damping / np.sqrt(stiffness)
    bodies = [int(model.geom_bodyid[k]) for k in feet]
    inverse_mass = float(np.median(model.body_invweight0[bodies, 0]))
    return Contact(friction, time, ratio, np.array(solimp), inverse_mass, max(condim, 3))


def touching(model: mujoco.MjModel, floor: int) -> list[int]:
    """Geoms of moving bodies that can touch a floor."""
    kind, affinity = int(model.geom_contype[floor]), int(model.geom_conaffinity[floor])
    return [
        k
        for k in range(model.ngeom)
        if int(model.body_weldid[model.geom_bodyid[k]]) > 0
        and (kind & int(model.geom_conaffinity[k]) or affinity & int(model.geom_contype[k]))
    ]


def _feet(model: mujoco.MjModel, floor: int) -> list[int]:
    """Geoms that can touch the floor, at the ends of the robot where there are such."""
    can = touching(model, floor)
    parents = {int(model.body_parentid[body]) for body in range(1, model.nbody)}
    ends = [k for k in can if int(model.geom_bodyid[k]) not in parents]
    return ends or can
