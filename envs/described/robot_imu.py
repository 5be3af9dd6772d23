"""The IMU that the YAML of a robot describes, put onto the robot's model."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np

from ...common.errors import SealegsError, nearest
from ...configs.check import checked_fields
from ..engine import turns
from ..engine.base import BaseLayout, quaternion
from ..engine.imu import KINDS, Imu, Kind, Spread, Switch
from ..engine.model_poses import stand
from ..engine.numbers import RobotError
from ..engine.robot import Robot
from .robot_entries import ImuEntry, SwitchEntry

NAMED_IMU = re.compile(r"(?:^|[\W_])imu(?:$|[\W_\d])", re.IGNORECASE)
"""Names of sites and bodies that are an IMU."""


MOST_TURNED = 2.0 * np.pi + 1e-3  # [rad] a whole turn, rounded up: an angle beyond it is in degrees
MOST_DELAY = 1.0  # [s] of a sample, beyond which it is in milliseconds; assumed


def check_units(where: str, rotation: Sequence[float] = (), delay: float = 0.0) -> None:
    """Refuse degrees and milliseconds.

    Args:
        where: the IMU is described, for the message.
        rotation: of it on its seat [rad].
        delay: of its samples [s].

    Raises:
        RobotError: an angle is more than a turn, or the delay no sample's.
    """
    if any(abs(angle) > MOST_TURNED for angle in rotation):
        told = ", ".join(f"{angle:g}" for angle in rotation)
        raise RobotError(
            f"{where}.rotation is [{told}], more than a turn (6.283 rad); give radians: 90 degrees are 1.5708."
        )
    if delay > MOST_DELAY:
        raise RobotError(
            f"{where}.delay is {delay:g} s; at most {MOST_DELAY:g} s is taken: give seconds, 20 ms are 0.02."
        )


def read_imu(document: Mapping[str, Any], robot: Robot) -> Imu:
    """The IMU of a robot.

    Args:
        document: ``imu`` of the robot's YAML.
        robot: that it is on.

    Raises:
        SealegsError: the robot has no free base, or a key, value, site or body is none or moves against the base,
            or a number has another unit.
    """
    entry = checked_fields("imu", dict(document), ImuEntry)
    check_units("imu", entry.rotation, entry.delay)
    assumed = Imu("")
    noise, bias = (
        checked_fields(f"imu.{key}", {**vars(getattr(assumed, key)), **getattr(entry, key)}, Spread)
        for key in ("noise", "bias")
    )
    for key, spread in (("noise", noise), ("bias", bias)):
        if min(spread.orientation, spread.turn_rate) < 0.0:
            raise RobotError(f"imu.{key} holds a standard deviation below 0; 0 is the least.")
    model = robot.build_spec().compile()
    layout = BaseLayout(robot)
    if (place := layout.base) is None:
        raise RobotError("imu: an IMU tells how a free base turns, and this base is fixed; give base: free.")
    root = int(model.dof_bodyid[place[1]])
    own = quaternion(*entry.rotation)
    body, turn = _seat(entry, model, root)
    if model.body_weldid[body] != model.body_weldid[root]:
        raise RobotError(
            f"imu: joints move body '{model.body(body).name}' against the base '{model.body(root).name}'; mount it on "
            "the base, or on a body that no joint moves against it."
        )
    mount = turns.multiply(turn, own)
    said = {**vars(entry), "rotation": list(entry.rotation), "noise": {**vars(noise)}, "bias": {**vars(bias)}}
    standing = np.array(model.qpos0)
    stand(model, robot.pose, standing)
    upright = standing[place[0] + 3 : place[0] + 7]
    return Imu(
        layout.base_name, mount=tuple(mount.tolist()), upright=tuple(upright.tolist()), rate=entry.rate,
        delay=entry.delay, noise=noise, bias=bias, fallen=entry.fallen, silent=entry.silent,
        switches=tuple(_switch(str(name), row, model) for name, row in entry.switches.items()), said=said,
    )  # fmt: skip


def _switch(name: str, row: Any, model: mujoco.MjModel) -> Switch:
    """A contact switch.

    Raises:
        SealegsError: its name is no word, or the model has no such place, or nothing there that touches.
    """
    where = f"imu.switches.{name}"
    if not name.isidentifier():
        raise RobotError(f"{where}: the name of a switch is letters, digits and _, such as fl_foot.")
    entry = checked_fields(where, row, SwitchEntry)
    given: list[tuple[Kind, str]] = [(kind, place) for kind in KINDS if (place := getattr(entry, kind)) is not None]
    if len(given) != 1:
        raise RobotError(f"{where} needs one place: body, geom or site; it has {len(given)}.")
    kind, place = given[0]
    if place not in (known := _names(model, kind)):
        raise RobotError(f"{where}.{kind}: the model has no {kind} '{place}'{nearest(place, known)}.")
    number = known.index(place)
    body = number if kind == "body" else int((model.geom_bodyid if kind == "geom" else model.site_bodyid)[number])
    geoms = [number] if kind == "geom" else np.flatnonzero(model.geom_bodyid == body)
    if not any(model.geom_contype[k] or model.geom_conaffinity[k] for k in geoms):
        raise RobotError(f"{where}.{kind}: {place} has no shape that touches anything, so the switch never closes.")
    return Switch(name, kind, place, entry.threshold)


def _names(model: mujoco.MjModel, kind: str) -> list[str]:
    """Names of the bodies, geoms or sites of a model by number."""
    count = {"body": model.nbody, "geom": model.ngeom, "site": model.nsite}[kind]
    return [getattr(model, kind)(k).name for k in range(count)]


def seat_of_imu(robot: Robot) -> dict[str, str]:
    """The site or body of the base that a model calls an IMU, as ``imu`` of a YAML has it; empty: there is none."""
    model = robot.build_spec().compile()
    named = [("site", model.site(k).name) for k in range(model.nsite)]
    named += [("body", model.body(k).name) for k in range(1, model.nbody)]
    for kind, name in named:
        if NAMED_IMU.search(name):
            with suppress(SealegsError):  # it moves against the base, or there is none that moves
                read_imu({kind: name}, robot)
                return {kind: name}
    return {}


def with_imu(robot: Robot, document: Mapping[str, Any] | None) -> Robot:
    """The robot with the IMU that its YAML describes.

    Raises:
        SealegsError: as :func:`read_imu`.
    """
    return robot if document is None else replace(robot, imu=read_imu(document, robot))


def _seat(entry: ImuEntry, model: mujoco.MjModel, root: int) -> tuple[int, np.ndarray]:
    """The body that the IMU sits on, and the turn of its seat against the base.

    Raises:
        RobotError: the model has no such site or body, or both are named.
    """
    if entry.site is not None and entry.body is not None:
        raise RobotError("imu has a site and a body; give one of them.")
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    base = turns.inverse(np.array(data.xquat[root]))
    if entry.site is not None:
        sites = _names(model, "site")
        if entry.site not in sites:
            raise RobotError(f"imu.site: the model has no site '{entry.site}'{nearest(entry.site, sites)}.")
        number, turn = model.site(entry.site).id, np.zeros(4)
        mujoco.mju_mat2Quat(turn, data.site_xmat[number])
        return int(model.site_bodyid[number]), turns.multiply(base, turn)
    if entry.body is None:
        return root, np.array([1.0, 0.0, 0.0, 0.0])
    bodies = _names(model, "body")[1:]
    if entry.body not in bodies:
        raise RobotError(f"imu.body: the model has no body '{entry.body}'{nearest(entry.body, bodies)}.")
    number = model.body(entry.body).id
    return number, turns.multiply(base, np.array(data.xquat[number]))
