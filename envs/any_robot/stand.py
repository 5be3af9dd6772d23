"""How a robot with a free base stands at the start of an episode: where its feet are, and how joints move them."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from ...common.errors import SealegsError
from ..engine.model_poses import in_turn, place_followers, stand, weight_of
from ..engine.robot import Robot

SINK = 0.03  # of the base's height: how far it is let down to find what touches; assumed
STEP = 1e-3  # [rad or m] of a joint, for derivatives
SOLE = 5  # driven coordinates that move a foot from which on its sole can stay level; assumed
DAMPING = 1e-3  # of the largest singular value: of the inverse of a foot's derivatives


@dataclass(frozen=True)
class Standing:
    """The stance that a robot starts in; the world's x is its forward, z is up, and the origin is below its base.

    Attributes:
        base: body with the free joint.
        qpos, dof: where that joint begins in positions and in speeds.
        height: of the base over its feet [m].
        weight: of the robot [N].
        up: the vertical in the base's frame (3,).
        forward: the forward direction in the base's frame (3,).
        feet: bodies that touch the ground.
        soles: where each touches, in its body's frame (f, 3) [m].
        places: of the soles relative to the base (f, 2) [m].
        per_metre: change of the coordinates that moves a sole by a metre along x, y, z (f, 3, k) [rad/m or m/m].
        per_turn: the same that turns a sole by a radian about the vertical (f, k); 0 of one that cannot stay level.
        able: shares of a motion forward, sideways and about the vertical that the legs can do (3,): legs of two joints
            that swing ahead cannot step aside, and turn by a part.
    """

    base: str
    qpos: int
    dof: int
    height: float
    weight: float
    up: np.ndarray
    forward: np.ndarray
    feet: tuple[str, ...]
    soles: np.ndarray
    places: np.ndarray
    per_metre: np.ndarray
    per_turn: np.ndarray
    able: np.ndarray

    @property
    def turns(self) -> np.ndarray:
        """Which half of a gait's cycle each foot swings in (f,): neighbours around the body take turns, 0 or 1."""
        order = np.argsort(np.argsort(np.arctan2(self.places[:, 1], self.places[:, 0])))
        return order % 2

    @property
    def aside(self) -> np.ndarray:
        """Of two feet, from the middle to the one that stands in the first half of the cycle (2,) [m]; else 0.

        More of them stand around the weight.
        """
        if len(self.feet) != 2:
            return np.zeros(2)
        first, second = self.places[np.argsort(self.turns)]
        return 0.5 * (second - first)


def standing(robot: Robot) -> Standing:
    """How ``robot`` stands.

    Raises:
        SealegsError: its base is not free, or it has no two feet on a floor.
    """
    drivetrain = robot.drivetrain()
    model = drivetrain.model
    free = [k for k in range(model.njnt) if model.jnt_type[k] == mujoco.mjtJoint.mjJNT_FREE]
    if not free:
        raise SealegsError(
            f"robot '{robot.name}' has no free base, and cannot walk; write base: free into its YAML, with floor and "
            "height, as sealegs new-robot does."
        )
    at, dof, body = (int(field[free[0]]) for field in (model.jnt_qposadr, model.jnt_dofadr, model.jnt_bodyid))
    data, home = mujoco.MjData(model), np.array(model.qpos0)[None].copy()
    stand(model, robot.pose, home)
    names = [item.name for item in drivetrain.coordinates]
    start = [robot.start.get(name, sum(robot.limits[name]) / 2.0) for name in names]

    def pose(angles: list[float], lower: float = 0.0) -> None:
        qpos = home.copy()
        for name, angle in zip(names, angles, strict=True):
            drivetrain.set_position(name, qpos, angle)
        place_followers(model, in_turn(model), qpos)
        data.qpos[:] = qpos[0]
        data.qpos[at + 2] -= lower
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)

    pose(start, SINK * abs(float(home[0, at + 2])))
    mujoco.mj_collision(model, data)
    points: dict[
        int, list[np.ndarray]
    ] = {}  # by body; bodies that move as one are one foot, called as the first of them
    for contact in data.contact[: data.ncon]:
        pair = [int(model.geom_bodyid[geom]) for geom in (contact.geom1, contact.geom2)]
        moving = [number for number in pair if model.body_weldid[number]]
        if len(moving) == 1:
            points.setdefault(int(model.body_weldid[moving[0]]), []).append(np.array(contact.pos))
    found = {number: np.mean(places, axis=0) for number, places in points.items() if number != body}
    if len(found) < 2:
        touching = ", ".join(model.body(number).name for number in points) or "nothing"
        raise SealegsError(
            f"robot '{robot.name}' has no two feet on its floor where episodes start ({touching} touches it); give its "
            "YAML floor, height and start with which it stands, as sealegs new-robot does."
        )
    soles = np.array([
        data.xmat[number].reshape(3, 3).T @ (place - data.xpos[number]) for number, place in found.items()
    ])  # fmt: skip
    numbers = list(found)

    def where() -> np.ndarray:
        """Place and turn of the soles (f, 6)."""
        rows = [data.xmat[n].reshape(3, 3) for n in numbers]
        places = [turn @ sole + data.xpos[n] for n, turn, sole in zip(numbers, rows, soles, strict=True)]
        return np.array([
            [*place, turn[2, 1], turn[0, 2], turn[1, 0]] for place, turn in zip(places, rows, strict=True)
        ])  # fmt: skip

    pose(start)
    places = where()[:, :3] - data.xpos[body]
    turn = np.array(data.xmat[body]).reshape(3, 3)
    rates = np.zeros((len(numbers), 6, len(names)))
    for column in range(len(names)):
        ends = []
        for sign in (1.0, -1.0):
            pose([angle + sign * STEP * (k == column) for k, angle in enumerate(start)])
            ends.append(where())
        rates[:, :, column] = (ends[0] - ends[1]) / (2.0 * STEP)
    height = float(-places[:, 2].mean())
    ways = np.array([_inverse(rate, height) for rate in rates])
    return Standing(
        base=model.body(body).name,
        qpos=at,
        dof=dof,
        height=height,
        weight=weight_of(model),
        up=turn[2].copy(),
        forward=turn[0].copy(),
        feet=tuple(model.body(number).name for number in numbers),
        soles=soles,
        places=places[:, :2],
        per_metre=ways[:, :3],
        per_turn=ways[:, 3],
        able=_able(rates[:, :2], ways[:, :2], places),
    )


def _able(rates: np.ndarray, ways: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Shares of a motion forward, sideways and about the vertical (3,) that soles follow.

    Args:
        rates: derivatives of the soles along x and y (f, 2, k).
        ways: coordinates per metre along them (f, 2, k).
        places: of the soles relative to the base (f, 3) [m].
    """
    ahead, aside = np.broadcast_to([1.0, 0.0], (len(places), 2)), np.broadcast_to([0.0, 1.0], (len(places), 2))
    asked = np.stack([ahead, aside, np.stack([-places[:, 1], places[:, 0]], axis=1)])
    done = np.einsum("fik,fjk,cfj->cfi", rates, ways, asked)
    return (done * asked).sum(axis=(1, 2)) / (asked**2).sum(axis=(1, 2))


def _inverse(rates: np.ndarray, height: float) -> np.ndarray:
    """Coordinates per metre of a sole and per radian about the vertical (4, k), from its derivatives (6, k).

    A sole that can keeps level, and as it is turned where it moves; one that cannot is not turned.
    """
    can = int((np.abs(rates).max(axis=0) > 0.0).sum()) >= SOLE
    rows = np.concatenate([rates[:3], height * rates[3:]]) if can else rates[:3]
    left, size, right = np.linalg.svd(rows, full_matrices=False)
    inverse = right.T @ np.diag(size / (size**2 + (DAMPING * size.max()) ** 2)) @ left.T
    turned = height * inverse[:, 5:] if can else np.zeros((rates.shape[1], 1))
    return np.concatenate([inverse[:, :3], turned], axis=1).T
