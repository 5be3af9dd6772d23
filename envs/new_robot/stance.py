"""Whether a robot whose base hangs in the air has feet to stand on, and the pose in which its servos let it stand.

A file says of a walking robot neither that its base is free nor where the ground is. Both are read from its limbs:
which of them are legs, and a pose in which their feet are on one level with the centre of mass over them. A pose counts
as one that stands once the simulation has stood in it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.optimize import least_squares

from ...common.errors import WARNING, SealegsError
from ..any_robot.reach import ReachTask
from ..described.as_robot import as_robot, bare_model
from ..described.robot_described import FileJoint, RobotFile
from ..described.robot_entries import FloorEntry
from ..described.robot_step import said_again, scaled, settled
from ..engine.batch import BatchEngine
from ..engine.model_poses import weight_of

LEG = re.compile(r"leg|foot|feet|toe|ankle|thigh|femur|knee|shank|calf|shin|tibia|coxa|haa|hfe|kfe", re.IGNORECASE)
"""What names of joints and bodies of a leg have in them."""
OTHER = re.compile(r"arm|hand|finger|grip|wrist|thumb|wheel|neck|head", re.IGNORECASE)
"""What names of limbs have in them that a robot does not stand on."""
ALIKE = 0.1  # of the size of a robot, by which feet of one level differ where the file was drawn; assumed
LEVEL = 0.01  # of its size, by which feet of a stance may differ in height, as a weight of the search
OVER = 0.05  # of its size: of the centre of mass, from the middle of the feet
EXTENDED = 0.85  # of the height with straight legs at which a robot stands: knees bend both ways of it; assumed
BENT = 0.5  # of half a joint's range: how gladly a joint leaves the pose of the file
SIDEWAYS = 0.3  # of its size: of a foot, from under the hip of its leg
TILT = 0.05  # of the sole of a leg with an ankle [rad]
ANKLED = 5  # joints of a leg from which on its sole can be level
DEEP = 1e-3  # of its size: how deep shapes of two bodies lie in each other that never touch on the machine; assumed
SAG = 0.03  # [rad] by which weight may bend a joint with an assumed servo
QUICK = 4.0  # how many times as fast as it falls over, as a pendulum on its feet, its servos move its weight; assumed
SPHERES = 64  # points that stand for a geom, at most
SOFT = 0.01  # of its size: how far above the lowest point of a foot others count as its sole
STARTS = 6  # poses from which a stance is sought, that of the file first
SECONDS = 5.0  # [s] for which it has to stand
REACH = 0.5 * np.pi  # [rad] to which a joint of a leg goes from there, at most: many files state whole turns; assumed
RK4_EVALUATIONS = 4  # of the forces in a step, in place of one: feet that hit the ground are no smoother by them
LOWER, UPRIGHT = 0.2, 0.9  # share of its height by which it may sink, and cosine of a tilt, while it stands


@dataclass(frozen=True)
class Leg:
    """A limb that a robot can stand on.

    Attributes:
        joints: driven joints of the model from the base outwards, none of another limb.
        foot: bodies beyond the last of them.
    """

    joints: tuple[str, ...]
    foot: tuple[int, ...]

    @property
    def hip(self) -> str:
        """Joint that its foot stands under: the second, since the first one often turns a leg that begins beside it."""
        return self.joints[1 if len(self.joints) > 2 else 0]


@dataclass(frozen=True)
class Stance:
    """A pose on level ground.

    Attributes:
        angles: of the legs' driven coordinates, by name [rad or m].
        height: of the base over the ground [m].
        stiffness: with which servos hold it there and move it, by coordinate [N.m/rad], those of other limbs too.
        overlap: bodies whose shapes lie within each other there.
    """

    angles: dict[str, float]
    height: float
    stiffness: dict[str, float]
    overlap: tuple[tuple[str, str], ...]


def on_legs(robot: RobotFile) -> RobotFile:
    """The robot with a free base on a floor, in a pose in which it stands, and sentences that say so.

    Left as it is one that has no legs, or a place to stand of its own.
    """
    found, sentence = _on_legs(robot)
    if found is robot:
        return robot if not sentence else replace(robot, said=(*robot.said, sentence))
    step = f"{robot.model.path.name}: the simulation steps by "
    said = [item for item in said_again(robot.said, robot.joints, found.joints) if not item.startswith(step)]
    said.append(f"{step}{1e3 * found.timestep:g} ms, with {found.integrator}.")
    if found.exclude:
        pairs = ", ".join(" and ".join(pair) for pair in found.exclude)
        said.append(f"{robot.model.path.name}: shapes lie within each other as it stands, and never touch: {pairs}.")
    if narrow := [item.name for item, old in zip(found.joints, robot.joints, strict=True) if item.range != old.range]:
        said.append(
            f"{robot.model.path.name}: goals of {', '.join(narrow)} keep within {REACH:.3g} rad of their start, as "
            "legs need no more (assumed)."
        )
    return replace(found, said=(*said, sentence))


def _on_legs(robot: RobotFile) -> tuple[RobotFile, str]:
    model = robot.model
    if not model.root or model.floor or any(joint.body == model.root for joint in model.joints.values()):
        return robot, ""
    free = replace(robot, base="free")
    try:
        body = _Body(free)
    except ValueError:  # MuJoCo lets no base move that has no mass
        return robot, ""
    if len(body.legs) < 2:
        return robot, ""
    where = f"{model.path.name}: {_counted(len(body.legs))} legs"
    if bare := [leg for leg in body.legs if not body.shapes(leg)]:
        free = replace(free, feet=tuple(body.heaviest(leg) for leg in bare))
        body = _Body(free)
    held = "hang in the air" if not model.free else "have no floor under them"
    best: RobotFile | None = None
    for stance in body.stances():
        standing = _stood(free, stance)
        best = standing if best is None else best
        if _stands(standing):
            feet = f" Boxes of their inertias stand for {', '.join(free.feet)}, without a shape." if free.feet else ""
            pose = f"it stands {SECONDS:g} s at a height of {stance.height:.3g} m"
            return standing, f"{where} {held}: base is free, with a floor and an IMU, and {pose} on its servos.{feet}"
    assert best is not None
    return best, (
        f"{WARNING}{where} {held}: base is free, with a floor and an IMU, but it stands {SECONDS:g} s on its servos in "
        "no pose that was tried; give start and height of one that does, or stronger chains."
    )


def _counted(number: int) -> str:
    words = ("two", "three", "four", "five", "six", "seven", "eight")
    return words[number - 2] if number - 2 < len(words) else str(number)


class _Body:
    """A robot with a free base, compiled without actuators."""

    def __init__(self, robot: RobotFile) -> None:
        self._model = model = bare_model(robot)
        self._data = mujoco.MjData(model)
        self._root = model.body(robot.model.root).id
        self._items = {item.joint: item for item in robot.joints if len(item.terms) == 1}
        self._home = np.array(model.qpos0)
        for name, item in self._items.items():
            self._home[self._at(name)] = item.start / item.terms[0][1]
        self._forward(self._home)
        places = self._data.xpos[self._root :]
        self.size = float(np.linalg.norm(np.ptp(places, axis=0)))
        self._points = {body: self._sample(body) for body in range(1, model.nbody)}
        self.legs = self._legs()

    def shapes(self, leg: Leg) -> bool:
        """Whether its foot has a shape that touches."""
        return any(len(self._points[body][0]) for body in leg.foot)

    def heaviest(self, leg: Leg) -> str:
        """The heaviest body of a foot."""
        return self._model.body(max(leg.foot, key=lambda body: self._model.body_mass[body])).name

    # --- which limbs are legs --------------------------------------------------------------------------------------

    def _legs(self) -> list[Leg]:
        limbs = self._limbs()
        named = [limb for limb in limbs if LEG.search(self._words(limb))]
        if len(named) >= 2:
            return named
        others = [limb for limb in limbs if len(limb.joints) > 1 and not OTHER.search(self._words(limb))]
        if len(others) < 2 or not all(self.shapes(limb) for limb in others):
            return []
        ends = [self._sole(limb)[2] for limb in others]
        body = min((self._lowest([k]) for k in self._rigid(self._root)), default=np.inf)
        lowest = min(ends)
        level = [limb for limb, end in zip(others, ends, strict=True) if end - lowest < ALIKE * self.size]
        return level if len(level) >= 2 and lowest < body - ALIKE * self.size else []

    def _limbs(self) -> list[Leg]:
        model = self._model
        bodies = {name: int(model.joint(name).bodyid[0]) for name in self._items}
        paths = {name: set(self._path(body)) for name, body in bodies.items()}
        beyond = {
            name: [other for other in bodies if other != name and bodies[name] in paths[other]] for name in bodies
        }
        found = []
        for last in [name for name, outer in beyond.items() if not outer]:
            way = sorted((name for name in bodies if bodies[name] in paths[last]), key=lambda name: len(paths[name]))
            own = [name for name in way if not [other for other in beyond[name] if other not in way]]
            foot = [k for k in range(1, model.nbody) if bodies[last] in self._path(k)]
            found.append(Leg(tuple(own), tuple(foot)))
        return found

    def _words(self, limb: Leg) -> str:
        model = self._model
        bodies = {int(model.joint(name).bodyid[0]) for name in limb.joints} | set(limb.foot)
        return " ".join([*limb.joints, *(model.body(k).name for k in bodies)])

    def _path(self, body: int) -> list[int]:
        """A body and those that carry it, up to below the world."""
        found = []
        while body:
            found.append(body)
            body = int(self._model.body_parentid[body])
        return found

    def _rigid(self, body: int) -> list[int]:
        """Bodies that move as one with a body."""
        weld = self._model.body_weldid
        return [k for k in range(1, self._model.nbody) if weld[k] == weld[body]]

    # --- where a robot touches --------------------------------------------------------------------------------------

    def _sample(self, body: int) -> tuple[np.ndarray, np.ndarray]:
        """Spheres that stand for what a body touches with: centres in its frame (n, 3) and radii (n,) [m]."""
        model, places, radii = self._model, [np.zeros((0, 3))], [np.zeros(0)]
        kinds = mujoco.mjtGeom
        for geom in np.flatnonzero(model.geom_bodyid == body):
            if not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
                continue
            kind, size = int(model.geom_type[geom]), model.geom_size[geom]
            corners = np.array(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0])).reshape(3, 8).T
            radius = 0.0
            if kind == kinds.mjGEOM_MESH:
                mesh = int(model.geom_dataid[geom])
                first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
                local = model.mesh_vert[first : first + count]
                local = local[_extreme(local)]
            elif kind in (kinds.mjGEOM_SPHERE, kinds.mjGEOM_CAPSULE):
                radius = float(size[0])
                ends = [0.0] if kind == kinds.mjGEOM_SPHERE else [-size[1], size[1]]
                local = np.array([[0.0, 0.0, end] for end in ends])
            else:  # a cylinder's rim and an ellipsoid lie within the box
                local = corners * (size if kind != kinds.mjGEOM_CYLINDER else [size[0], size[0], size[1]])
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
            places.append(local @ turn.reshape(3, 3).T + model.geom_pos[geom])
            radii.append(np.full(len(local), radius))
        return np.concatenate(places), np.concatenate(radii)

    def _touching(self, bodies: Sequence[int]) -> np.ndarray:
        """Lowest points (n, 3) of the spheres of bodies, as they stand [m]."""
        found = [np.zeros((0, 3))]
        for body in bodies:
            places, radii = self._points[body]
            placed = places @ self._data.xmat[body].reshape(3, 3).T + self._data.xpos[body]
            placed[:, 2] -= radii
            found.append(placed)
        return np.concatenate(found)

    def _lowest(self, bodies: Sequence[int]) -> float:
        points = self._touching(bodies)
        return float(points[:, 2].min()) if len(points) else np.inf

    def _sole(self, leg: Leg) -> np.ndarray:
        """Where a foot touches (3,) [m]: the middle of its lowest points, without a jump from corner to corner."""
        points = self._touching(leg.foot)
        weights = np.exp(-(points[:, 2] - points[:, 2].min()) / (SOFT * self.size))
        middle = weights @ points / weights.sum()
        middle[2] = points[:, 2].min()
        return middle

    # --- how it stands ----------------------------------------------------------------------------------------------

    def stances(self) -> Iterator[Stance]:
        """Poses on level ground, the likeliest first, and that of the file at the end."""
        names = [name for leg in self.legs for name in leg.joints]
        places = [self._at(name) for name in names]
        low, high = np.array([self._range(name) for name in names]).T
        home, half = np.clip(self._home[places], low, high), 0.5 * np.minimum(high - low, np.pi)
        random = np.random.default_rng(0)
        drawn = [np.clip(home + half * random.uniform(-1.0, 1.0, len(home)), low, high) for _ in range(64)]
        tall = EXTENDED * max(self._height(places, angles) for angles in (home, *drawn))

        self._pose(places, home)
        level = {leg.foot[0]: self._data.xmat[leg.foot[0]].reshape(3, 3)[2].copy() for leg in self.legs}

        def residual(angles: np.ndarray) -> np.ndarray:
            self._pose(places, angles)
            soles = np.array([self._sole(leg) for leg in self.legs])
            ground, middle = soles[:, 2].mean(), soles[:, :2].mean(axis=0)
            centre = self._data.subtree_com[self._root]
            hips = np.array([self._data.xanchor[self._model.joint(leg.hip).id] for leg in self.legs])
            tilts = [
                self._data.xmat[leg.foot[0]].reshape(3, 3)[:2] @ level[leg.foot[0]] / TILT
                for leg in self.legs
                if len(leg.joints) >= ANKLED
            ]
            return np.concatenate([
                (soles[:, 2] - ground) / (LEVEL * self.size),
                (centre[:2] - middle) / (OVER * self.size),
                [(self._data.xpos[self._root][2] - ground - tall) / (LEVEL * self.size)],
                ((soles - hips)[:, :2] / (SIDEWAYS * self.size)).ravel(),
                BENT * (angles - home) / np.maximum(half, 1e-3),
                *tilts,
            ])  # fmt: skip

        inside = 1e-3 * (high - low)
        starts = [home, 0.5 * (low + high), *drawn][:STARTS]
        fits = [
            least_squares(
                residual, np.clip(start, low + inside, high - inside), bounds=(low, high), x_scale=half + 1e-3
            )
            for start in starts
        ]
        for fit in sorted(fits, key=lambda fit: fit.cost):
            yield self._stance(names, places, fit.x)
        yield self._stance(names, places, home)

    def _height(self, places: list[int], angles: np.ndarray) -> float:
        """Of the base over its lowest foot [m]."""
        self._pose(places, angles)
        return float(self._data.xpos[self._root][2] - min(self._lowest(leg.foot) for leg in self.legs))

    def _stance(self, names: list[str], places: list[int], angles: np.ndarray) -> Stance:
        """The pose with its height, and the stiffness of servos whose legs carry equal shares of its weight there.

        Weight bends none by more than :data:`SAG`, and a leg with its foot on the ground moves its share as fast as a
        gait asks for; of two legs, over that foot too, for no other one holds it.
        """
        height, model, data = self._height(places, angles), self._model, self._data
        data.qvel[:] = 0.0
        mujoco.mj_fwdVelocity(model, data)
        forces = data.qfrc_bias - data.qfrc_passive
        weight = weight_of(model)
        share = weight / len(self.legs)
        over = height + float(data.subtree_com[self._root][2] - data.xpos[self._root][2])  # the ground
        moved: dict[str, float] = {}
        for leg in self.legs:
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, jacobian, None, self._sole(leg), leg.foot[0])
            forces -= share * jacobian[2]
            for name in leg.joints:
                lever = float(np.linalg.norm(jacobian[:, self._dof(name)]))  # [m]
                lever = max(lever, over) if len(self.legs) == 2 else lever  # an ankle moves what stands on it
                moved[name] = QUICK**2 * share * lever**2 / over
        items = self._items
        return Stance(
            {items[n].name: float(a * items[n].terms[0][1]) for n, a in zip(names, angles, strict=True)},
            height,
            {
                item.name: max(abs(float(forces[self._dof(n)])) / SAG, moved.get(n, 0.0)) / item.terms[0][1] ** 2
                for n, item in items.items()
            },
            self._overlap(),
        )

    def _overlap(self) -> tuple[tuple[str, str], ...]:
        """Bodies whose shapes lie within each other as the robot stands."""
        model, data = self._model, self._data
        mujoco.mj_collision(model, data)
        found = set()
        for contact in data.contact[: data.ncon]:
            bodies = sorted(int(model.geom_bodyid[geom]) for geom in (contact.geom1, contact.geom2))
            if contact.dist < -DEEP * self.size and bodies[0]:
                found.add((model.body(bodies[0]).name, model.body(bodies[1]).name))
        return tuple(sorted(pair for pair in found if all(pair)))

    def _range(self, name: str) -> tuple[float, float]:
        item = self._items[name]
        low, high = sorted(end / item.terms[0][1] for end in item.range)
        return low, high

    def _at(self, name: str) -> int:
        return int(self._model.jnt_qposadr[self._model.joint(name).id])

    def _dof(self, name: str) -> int:
        return int(self._model.jnt_dofadr[self._model.joint(name).id])

    def _pose(self, places: list[int], angles: np.ndarray) -> None:
        qpos = self._home.copy()
        qpos[places] = angles
        self._forward(qpos)

    def _forward(self, qpos: np.ndarray) -> None:
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)


def _extreme(points: np.ndarray) -> np.ndarray:
    """Numbers of points that lie farthest in some direction: they stand for a mesh."""
    k = np.arange(SPHERES) + 0.5
    polar, around = np.arccos(1.0 - 2.0 * k / SPHERES), np.pi * (1.0 + 5.0**0.5) * k
    ways = np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)])
    return np.unique((points @ ways).argmax(axis=0))


def _stood(robot: RobotFile, stance: Stance) -> RobotFile:
    """The robot in a stance, on a floor, with assumed servos that hold it."""
    joints = []
    for item in robot.joints:
        held = stance.stiffness.get(item.name, 0.0)
        joints.append(_strong(_within(item, stance.angles.get(item.name)), held))
    standing = replace(
        robot, joints=tuple(joints), floor=FloorEntry(), height=float(f"{stance.height:.4g}"), exclude=stance.overlap
    )
    exact, quick = settled(standing, None)[0], settled(standing, "implicitfast")[0]
    return quick if quick.timestep > exact.timestep / RK4_EVALUATIONS and quick.joints == exact.joints else exact


def _within(item: FileJoint, start: float | None) -> FileJoint:
    """A joint of a leg with its start [rad or m], and goals within reach of it; the same joint without a start."""
    if start is None:
        return item
    low, high = item.range
    if item.kind != "hinge" or item.by_speed or high - low <= 2.0 * REACH:
        return replace(item, start=start)
    within = max(low, round(start - REACH, 3)), min(high, round(start + REACH, 3))
    note = f"its goals keep within {REACH:.3g} rad of its start, as a leg needs no more (assumed)"
    return replace(item, start=start, range=within, notes=(note, *item.notes))


def _strong(item: FileJoint, stiffness: float) -> FileJoint:
    """A joint whose assumed servo has at least a stiffness [N.m/rad], and the damping that goes with it."""
    if item.least is None or item.kind != "hinge":
        return item
    needed, stiffness = float(f"{stiffness:.4g}"), item.chain.value("ideal.stiffness")
    if needed <= stiffness:
        return item
    kept = [note for note in item.notes if not note.startswith("an ideal servo of ")]
    note = f"an ideal servo of {needed:g} N.m/rad drives it (assumed, from the weight that it holds and moves)"
    return replace(item, chain=scaled(item.chain, needed / stiffness), least=needed, notes=(*kept, note))


def _stands(robot: RobotFile) -> bool:
    """Whether it stands on its servos for :data:`SECONDS`."""
    task = ReachTask.on(as_robot(robot))(start_noise=0.0)
    try:
        engine = BatchEngine(task, 1, autoreset=False)
    except SealegsError:  # a chain that the step makes unstable
        return False
    engine.seed(0)
    engine.reset()
    body = engine.drivetrain.model.body(robot.model.root).id
    at = int(engine.drivetrain.model.jnt_qposadr[engine.drivetrain.model.body_jntadr[body]])
    rest = (task.centre - engine.goal_centre) / engine.goal_half
    qpos = engine.batch.bind("qpos")
    start = qpos[0, at : at + 7].copy()
    for _ in range(round(SECONDS / engine.dt)):
        if engine.step(rest[None]).flags["unstable"][0]:
            return False
        now = qpos[0, at : at + 7]
        up = _up(now[3:]) @ _up(start[3:])
        if now[2] < (1.0 - LOWER) * start[2] or up < UPRIGHT:
            return False
    return True


def _up(quaternion: np.ndarray) -> np.ndarray:
    """The world's vertical in a body's frame (3,)."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, quaternion)
    return turn.reshape(3, 3)[2].copy()
