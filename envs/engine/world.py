"""What a task sees of the simulated world beyond joints: contacts, poses and speeds of bodies and sites, sensors.

A task says in ``sees`` what it needs, and finds it in ``motion.world``, for all simulations at once. Rewards and ends
may use all of it. An observation may not: a policy sees what the machine measures.

Contacts, speeds and sensors are as of the last physics step's beginning, as MuJoCo has them after a step.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import mujoco
import numpy as np
from mujoco.batch import Batch

from ...common.errors import SealegsError, nearest
from .robot import Robot
from .turns import cross

TOUCH = {"ground": "world", "contacts": ""}
"""Words of ``sees`` that count contacts: with what does not move, or with anything."""
AVERAGED = 0.4  # [s] of mean speeds, unless the task says how long: about two steps of a small robot; assumed
SEES = (*TOUCH, "bodies", "sites", "sensors")
"""Words of ``sees``."""
_FIELDS = {"bodies": ("xpos", "xmat", "cvel", "subtree_com"), "sites": ("site_xpos", "site_xmat"), "sensors": ()}
_FOUND_AND_FORCE, _NET_FORCE = 0b11, 3  # of a contact sensor: data, reduction


def with_contacts(robot: Robot, sees: Sequence[str]) -> Robot:
    """The robot with a contact sensor for each of its bodies, where a task sees contacts.

    Raises:
        SealegsError: ``sees`` has a word that is none.
    """
    for word in sees:
        if word not in SEES:
            raise SealegsError(f"a task sees {', '.join(SEES)}; '{word}' is none of them{nearest(word, SEES)}.")
    words = [word for word in sees if word in TOUCH]
    if not words:
        return robot

    def build(values: Mapping[str, float]) -> mujoco.MjSpec:
        spec = robot.build(values)
        for body in _touchable(spec):
            for word in words:
                sensor = spec.add_sensor(name=f"{word}/{body}", type=mujoco.mjtSensor.mjSENS_CONTACT)
                sensor.reftype, sensor.refname = mujoco.mjtObj.mjOBJ_BODY, body
                if TOUCH[word]:  # the first of the two: the force is the one on the second
                    sensor.objtype, sensor.objname = mujoco.mjtObj.mjOBJ_BODY, TOUCH[word]
                sensor.intprm[:3] = _FOUND_AND_FORCE, _NET_FORCE, 1
        return spec

    return dataclasses.replace(robot, build=build)


def _touchable(spec: mujoco.MjSpec) -> list[str]:
    """Named bodies with a shape that can touch."""
    return [
        body.name
        for body in spec.bodies
        if body.name and body.name != "world" and any(geom.contype or geom.conaffinity for geom in body.geoms)
    ]


class World:
    """The world of n simulations, as a task sees it; arrays are not to be written to.

    Names that the model does not have are refused in a sentence.

    Attributes:
        simulated: whether there is one; on the machine there is not.
    """

    simulated = True

    def __init__(self, batch: Batch, sees: Sequence[str], averaged: int = 1) -> None:
        """See in ``batch`` what the words of ``sees`` name, and mean speeds over ``averaged`` control steps."""
        model = self._model = batch.model
        self._sees = tuple(sees)
        names = [name for word in sees for name in _FIELDS.get(word, ())]
        self._bound: dict[str, np.ndarray] = {name: batch.bind(name) for name in names}
        self._sensors = batch.bind("sensordata") if {*sees} & {*TOUCH, "sensors"} else np.empty((batch.nsim, 0))
        self._touch = {word: _Touch(model, word) for word in TOUCH if word in sees}
        self._air = {word: np.zeros((batch.nsim, len(touch.names))) for word, touch in self._touch.items()}
        self._landed = {word: np.zeros_like(air) for word, air in self._air.items()}
        seen = averaged if "bodies" in sees else 0
        shape = (batch.nsim, model.nbody, 6)
        self._sum, self._speeds, self._oldest = np.zeros(shape), np.zeros((seen, *shape)), 0

    # --- contacts ----------------------------------------------------------------------------------------------

    def touchable(self, word: str = "ground") -> tuple[str, ...]:
        """Bodies with a shape that can touch; those that are fixed to each other are one, called as the first."""
        return self._touched(word).names

    def touching(self, bodies: Sequence[str], word: str = "ground") -> np.ndarray:
        """Whether each body touches the ground, or with ``word`` of ``contacts`` anything (n, b)."""
        return self._touched(word).found(self._sensors)[:, self._columns(word, bodies)] > 0.0

    def contact_force(self, bodies: Sequence[str], word: str = "ground") -> np.ndarray:
        """Sum of the contact forces on each body, in the world (n, b, 3) [N]."""
        return self._touched(word).force(self._sensors)[:, self._columns(word, bodies)]

    def air_time(self, bodies: Sequence[str], word: str = "ground") -> np.ndarray:
        """How long each body has not touched; 0 of one that touches (n, b) [s]."""
        return self._air[word][:, self._columns(word, bodies)]

    def landed(self, bodies: Sequence[str], word: str = "ground") -> np.ndarray:
        """How long each body that touches since this control step had not touched; 0 of the others (n, b) [s]."""
        return self._landed[word][:, self._columns(word, bodies)]

    # --- poses, speeds, sensors --------------------------------------------------------------------------------

    def position(self, body: str, point: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
        """Of a point that is given in the body's frame, in the world (n, 3) [m]."""
        turned = (self.rotation(body) * np.asarray(point)).sum(axis=-1)  # no @: its rounding depends on n
        return self._field("bodies", "xpos")[:, self._body(body)] + turned

    def rotation(self, body: str) -> np.ndarray:
        """From the body's frame to the world's (n, 3, 3)."""
        return self._field("bodies", "xmat")[:, self._body(body)].reshape(-1, 3, 3)

    def velocity(self, body: str, point: Sequence[float] = (0.0, 0.0, 0.0)) -> np.ndarray:
        """Of a point that is given in the body's frame, in the world (n, 3) [m/s]."""
        number = self._body(body)
        centre = self._field("bodies", "subtree_com")[:, self._model.body_rootid[number]]
        linear = self._field("bodies", "cvel")[:, number, 3:]
        return linear + cross(self.turn_rate(body), self.position(body, point) - centre)

    def turn_rate(self, body: str) -> np.ndarray:
        """Of a body about the world's axes (n, 3) [rad/s]."""
        return self._field("bodies", "cvel")[:, self._body(body), :3]

    def mean_velocity(self, body: str) -> np.ndarray:
        """Of the body's origin over the last control steps of the episode, in the world (n, 3) [m/s].

        As many as :meth:`sealegs.envs.engine.task.Task.averaged` says: over a whole cycle a gait does not sway.
        """
        self._field("bodies", "cvel")
        return self._sum[:, self._body(body), 3:] / len(self._speeds)

    def mean_turn_rate(self, body: str) -> np.ndarray:
        """Of a body about the world's axes, likewise (n, 3) [rad/s]."""
        self._field("bodies", "cvel")
        return self._sum[:, self._body(body), :3] / len(self._speeds)

    def site_position(self, site: str) -> np.ndarray:
        """In the world (n, 3) [m]."""
        return self._field("sites", "site_xpos")[:, self._number("site", site)]

    def site_rotation(self, site: str) -> np.ndarray:
        """From the site's frame to the world's (n, 3, 3)."""
        return self._field("sites", "site_xmat")[:, self._number("site", site)].reshape(-1, 3, 3)

    def sensor(self, name: str) -> np.ndarray:
        """A sensor of the model file (n, d), in MuJoCo's units and frames."""
        self._field("sensors", "")
        number = self._number("sensor", name)
        start = int(self._model.sensor_adr[number])
        return self._sensors[:, start : start + int(self._model.sensor_dim[number])]

    # --- the engine's side -------------------------------------------------------------------------------------

    def advance(self, dt: float) -> None:
        """A control step of ``dt`` [s] has passed."""
        for word, touch in self._touch.items():
            touching = touch.found(self._sensors) > 0.0
            self._landed[word] = np.where(touching, self._air[word], 0.0)
            self._air[word] = np.where(touching, 0.0, self._air[word] + dt)
        if "bodies" in self._sees:
            turn, linear = self._bound["cvel"][..., :3], self._bound["cvel"][..., 3:]
            centres = self._bound["subtree_com"][:, self._model.body_rootid]
            now = np.concatenate([turn, linear + cross(turn, self._bound["xpos"] - centres)], axis=-1)
            self._sum += now - self._speeds[self._oldest]
            self._speeds[self._oldest] = now
            self._oldest = (self._oldest + 1) % len(self._speeds)

    def start(self, chosen: np.ndarray) -> None:
        """Episodes start in the simulations ``chosen``."""
        for word, air in self._air.items():
            air[chosen] = 0.0
            self._landed[word][chosen] = 0.0
        self._sum[chosen] = 0.0
        self._speeds[:, chosen] = 0.0

    def _field(self, word: str, name: str) -> np.ndarray:
        if word not in self._sees:
            raise SealegsError(f"the task does not see {word}: write sees = ({word!r},) in its class.")
        return self._bound.get(name, self._sensors)

    def _touched(self, word: str) -> _Touch:
        if word not in self._touch:
            raise SealegsError(f"the task does not see {word}: write sees = ({word!r},) in its class.")
        return self._touch[word]

    def _columns(self, word: str, bodies: Sequence[str]) -> list[int]:
        columns = self._touched(word).columns
        for name in bodies:
            if name not in columns:
                raise SealegsError(f"the model has no body that can touch '{name}'{nearest(name, columns)}.")
        return [columns[name] for name in bodies]

    def _body(self, name: str) -> int:
        return self._number("body", name)

    def _number(self, kind: str, name: str) -> int:
        accessor: Callable[[Any], Any] = getattr(self._model, kind)
        try:
            return int(accessor(name).id)
        except KeyError:
            count = {"body": self._model.nbody, "site": self._model.nsite, "sensor": self._model.nsensor}[kind]
            known = [accessor(k).name for k in range(count)]
            raise SealegsError(f"the model has no {kind} '{name}'{nearest(name, known)}.") from None


class _Touch:
    """The contact sensors of a word.

    Attributes:
        names: of what can touch: bodies that are fixed to each other are one.
        columns: of every body that is part of one, by its name.
    """

    def __init__(self, model: mujoco.MjModel, word: str) -> None:
        sensors: dict[int, list[int]] = {}
        for number in range(model.nsensor):
            kind, _, body = model.sensor(number).name.partition("/")
            if kind == word and (rigid := int(model.body_weldid[model.body(body).id])):
                sensors.setdefault(rigid, []).append(int(model.sensor_adr[number]))
        rigid = list(sensors)
        parts = [(model.body(k).name, int(model.body_weldid[k])) for k in range(1, model.nbody)]
        self.columns = {name: rigid.index(which) for name, which in parts if name and which in sensors}
        self.names = tuple(next(name for name, which in parts if name and which == one) for one in rigid)
        self._addresses = np.array([address for one in rigid for address in sensors[one]], dtype=np.int64)
        self._begins = np.cumsum([0, *(len(sensors[one]) for one in rigid)])[:-1]

    def found(self, sensors: np.ndarray) -> np.ndarray:
        """Number of contacts (n, b)."""
        return np.add.reduceat(sensors[:, self._addresses], self._begins, axis=1)

    def force(self, sensors: np.ndarray) -> np.ndarray:
        """Sum of forces (n, b, 3) [N]."""
        return np.add.reduceat(sensors[:, self._addresses[:, None] + np.arange(1, 4)], self._begins, axis=1)


class _NoWorld:
    """Where there is no simulation: a policy on the machine."""

    simulated = False

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        raise SealegsError(
            "an observation uses motion.world, which no machine has: use what its encoders and its IMU measure."
        )


NO_WORLD = cast(World, _NoWorld())
