"""Domain randomisation: what every episode of every simulation draws anew, uniform between two values.

hip:     {friction.viscous: [0.25, 0.45]}       chain of one coordinate: stage.parameter
all:     {position_p.gain: {times: [0.8, 1.2]}} chains of all coordinates: multiples of their own value
mass:    {base: [0.9, 1.1]}                     multiples of a body's mass and inertia; all: every body together
centre:  {base.x: [-0.01, 0.01]}                shift of a body's centre of mass along its x, y or z [m]
gravity: {strength: [9.7, 9.9]}                 [m/s2]
floor:   {friction: [0.6, 1.0], slope: [0, 0.1]} sliding friction; a slope any way [rad], with the robot upright on it
         {rough: [0, 0.02], steps: [0, 0.02]}   from dips to bumps; between the lowest and the highest block, each as
                                                long as the robot [m]
push:    {speed: [0, 0.3], interval: [2, 4]}    a push changes the base's speed any way [m/s], once an interval [s]
noise:   {reading: [0, 0.01]}                   standard deviation of each encoder [rad or m], of the base's tilt
                                                [rad] and turn_rate [rad/s], new in every control step
bias:    {reading: [0, 0.02]}                   the same offset for an episode, up to the value either way
lost:    {goals: [0, 0.05], readings: [0, 0.02]} share of goals (of all servos together) and of replies of a servo
delay:   {goals: [0, 0.03]}                     of goals, in place of a fixed action_delay [s]
machines: {chains: ..., robot: ...}             of which each episode draws one (:class:`Machines`), in place of
                                                ranges of chains, mass, centre and gravity
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mujoco.batch import MODEL_FIELDS, Batch

from ...actuators import Chain, Drivetrain
from ...actuators.layout import P_STATE_SIZE
from ...common.documents import DocumentError, read_yaml
from ...common.errors import SealegsError, nearest
from .base import BaseLayout
from .scene import FLOOR
from .terrain import floors


class RandomizationError(SealegsError):
    """A randomisation that names something the robot does not have, or gives a range that is none."""


@dataclass(frozen=True)
class Draw:
    """One randomised number.

    Attributes:
        group: coordinate, or a word of :data:`GROUPS`.
        name: ``stage.parameter``, body, or a word of the group.
        low: smallest value.
        high: largest value.
    """

    group: str
    name: str
    low: float
    high: float


Source = Mapping[str, Any] | str | Path | None

FLOORS = {"friction": 0.0, "slope": 0.0, "rough": 0.0, "steps": 0.0}
UNEVEN = ("rough", "steps")
RUNNING = {
    "push": {"speed": 0.0, "interval": 0.1},
    "noise": {"reading": 0.0, "tilt": 0.0, "turn_rate": 0.0},
    "bias": {"reading": 0.0, "tilt": 0.0, "turn_rate": 0.0},
    "lost": {"goals": 0.0, "readings": 0.0},
    "delay": {"goals": 0.0},
}
"""What disturbs a running simulation (:mod:`sealegs.envs.engine.disturbances`): words of each group, and the smallest
value that one can have."""
GROUPS = ("mass", "centre", "gravity", "floor", *RUNNING)
MACHINES = "machines"
BESIDE_MACHINES = ("floor", *RUNNING)
"""What may vary beside whole machines: nothing that they have."""
OF_BASE = (
    "push.speed",
    "noise.tilt",
    "noise.turn_rate",
    "bias.tilt",
    "bias.turn_rate",
    *(f"floor.{name}" for name in FLOORS if name != "friction"),
)
"""What only a robot with a free base feels."""


class Randomization:
    """What of a drivetrain varies, and how to write drawn values into a batch.

    Attributes:
        draws: the numbers that vary, in the order of :meth:`apply`'s random numbers.
        chains: chain of each coordinate to build the drivetrain from, such that every value that can be drawn has its
            place: a friction law that the robot's own chain leaves out, or memory. Otherwise the robot's own.
    """

    def __init__(self, drivetrain: Drivetrain, source: Source = None, build: Build | None = None) -> None:
        """Check ``source``, a mapping as in the module's docstring or the path of a YAML file with one.

        Args:
            drivetrain: of the robot itself.
            source: what varies.
            build: makes the robot with other chains and numbers, for whole machines.

        Raises:
            RandomizationError: something in it does not fit the drivetrain.
            ChainError: a chain does not have a parameter or cannot take a value.
        """
        given = dict(read_randomization(source))
        machines = given.pop(MACHINES, None)
        self.draws = tuple(_draws(drivetrain, given))
        self._machines: Machines | None = None
        if machines is not None:
            self.draws = (*self.draws, self._of_machines(drivetrain, machines, build))
        self._nominal = drivetrain.chains
        self._columns = {
            group: [(k, draw) for k, draw in enumerate(self.draws) if draw.group == group]
            for group in (*drivetrain.chains, *GROUPS, MACHINES)
        }
        self.chains = {name: self._with_room(name) for name in self._nominal}

    def _of_machines(self, drivetrain: Drivetrain, source: Any, build: Build | None) -> Draw:
        """The draw of a whole machine, which are made here."""
        for draw in self.draws:
            if draw.group not in BESIDE_MACHINES:
                raise RandomizationError(
                    f"randomization.{draw.group}.{draw.name} and randomization.{MACHINES} both draw what a machine "
                    f"has; beside machines there may be {', '.join(BESIDE_MACHINES)}."
                )
        assert build is not None, "whoever gives machines says how they are built"
        self._machines = Machines(drivetrain, source, build)
        return Draw(MACHINES, "number", 0.0, 1.0)

    @property
    def disturbs(self) -> bool:
        """Whether something of it goes on while a simulation runs, for which an episode needs a key."""
        return any(draw.group in RUNNING or f"{draw.group}.{draw.name}" in OF_BASE for draw in self.draws)

    @property
    def level(self) -> bool:
        """Whether the floor is level and even."""
        return all(draw.name == "friction" for _, draw in self._columns["floor"])

    @property
    def uneven(self) -> dict[str, tuple[float, float]]:
        """Spans of :data:`UNEVEN` ground [m], by name."""
        return {draw.name: (draw.low, draw.high) for _, draw in self._columns["floor"] if draw.name in UNEVEN}

    def _with_room(self, name: str) -> Chain:
        chain = self._nominal[name]
        for _, draw in self._columns[name]:
            low, high = (chain.with_value(draw.name, value) for value in (draw.low, draw.high))
            if _memory(low) != _memory(high):
                raise RandomizationError(
                    f"randomization.{name}.{draw.name} reaches from {draw.low:g} to {draw.high:g}, but at "
                    f"{draw.low:g} the law keeps other memory: begin the range above it, at {draw.high / 1000.0:g} say."
                )
            wider = low if low.friction_needs_law() else high
            if (wider.friction_needs_law(), *_memory(wider)) != (chain.friction_needs_law(), *_memory(chain)):
                chain = wider
        return chain

    def apply(
        self, drivetrain: Drivetrain, batch: Batch, simulations: np.ndarray, random: np.ndarray
    ) -> dict[str, np.ndarray]:
        """Write new values into some simulations.

        Args:
            drivetrain: built from :attr:`chains`.
            batch: of its model.
            simulations: their numbers (m,), ascending.
            random: uniform numbers in [0, 1), (m, len(draws)).

        Returns:
            The values by ``group.name``, (m,) each.
        """
        if not self.draws:
            return {}
        low, high = (np.array([getattr(draw, end) for draw in self.draws]) for end in ("low", "high"))
        values = low + random * (high - low)
        if self._machines is not None:
            values[:, -1] = self._machines.apply(batch, simulations, random[:, -1])
        for name, nominal in self._nominal.items():
            for row, simulation in enumerate(simulations if self._columns[name] else ()):
                chain = nominal
                for column, draw in self._columns[name]:
                    chain = chain.with_value(draw.name, float(values[row, column]))
                drivetrain.set_chain(batch, name, chain, int(simulation))
        if self._columns["mass"] or self._columns["centre"]:
            self._change_bodies(batch, simulations, values)
        for column, _ in self._columns["gravity"]:
            batch.expand("opt.gravity")[simulations, 2] = -values[:, column]
        for column, draw in self._columns["floor"]:
            if draw.name == "friction":
                for floor in floors(batch.model):
                    batch.expand("geom_friction")[simulations, floor, 0] = values[:, column]
        return {f"{draw.group}.{draw.name}": values[:, column] for column, draw in enumerate(self.draws)}

    def _change_bodies(self, batch: Batch, simulations: np.ndarray, values: np.ndarray) -> None:
        model = batch.model
        for body in {draw.name.rpartition(".")[0] for _, draw in self._columns["centre"]}:
            number = model.body(body).id
            batch.expand("body_ipos")[simulations, number] = model.body_ipos[number]
        for column, draw in self._columns["centre"]:
            body, _, axis = draw.name.rpartition(".")
            batch.expand("body_ipos")[simulations, model.body(body).id, "xyz".index(axis)] += values[:, column]
        scale = np.ones((len(simulations), model.nbody))
        for column, draw in self._columns["mass"]:
            chosen = slice(None) if draw.name == "all" else model.body(draw.name).id
            scale[:, chosen] *= values[:, column, None] if draw.name == "all" else values[:, column]
        batch.expand("body_mass")[simulations] = model.body_mass * scale
        batch.expand("body_inertia")[simulations] = model.body_inertia * scale[..., None]
        batch.set_const(simulations)


def _memory(chain: Chain) -> tuple[int, int]:
    """Sizes of program and state, which a batch fixes for all its simulations."""
    program = chain.program()
    return len(program), int(program[P_STATE_SIZE])


def read_randomization(source: Source) -> Mapping[str, Any]:
    """The mapping that ``source`` is or that its YAML file holds; empty for None.

    Raises:
        RandomizationError: the file cannot be read, or holds no mapping.
    """
    if source is None:
        return {}
    if isinstance(source, Mapping):
        return source
    try:
        document = read_yaml(source, f"the randomisation {source}")
    except DocumentError as error:
        raise RandomizationError(f"{error}.") from None
    if not isinstance(document, Mapping):
        raise RandomizationError(f"{source}: a randomisation is a mapping such as 'floor: {{friction: [0.6, 1.0]}}'.")
    return document


def _draws(drivetrain: Drivetrain, source: Mapping[str, Any]) -> Iterable[Draw]:
    groups = [*drivetrain.chains, "all", *GROUPS, MACHINES]
    for group, entries in source.items():
        if group not in groups:
            raise RandomizationError(
                f"randomization has no '{group}'{nearest(group, groups)}; there are {', '.join(groups)}."
            )
        if not isinstance(entries, Mapping):
            raise RandomizationError(f"randomization.{group} must be 'name: [low, high]' pairs, not {entries!r}.")
        for name, value in entries.items():
            where = f"randomization.{group}.{name}"
            for target in drivetrain.chains if group == "all" else (group,):
                nominal = _nominal(drivetrain, target, str(name), where)
                low, high = _range(value, nominal, where)
                if target == "mass" and low <= 0.0:
                    raise RandomizationError(f"{where} begins at {low:g}; a body has mass: give factors above 0.")
                least = {**RUNNING, "floor": FLOORS}.get(target, {}).get(str(name), -np.inf)
                if low < least:
                    raise RandomizationError(f"{where} begins at {low:g}; it is never below {least:g}: begin there.")
                if target == "lost" and high > 1.0:
                    raise RandomizationError(f"{where} ends at {high:g}; it is a share: end at 1 at most.")
                yield Draw(target, str(name), low, high)


def _nominal(drivetrain: Drivetrain, group: str, name: str, where: str) -> float:
    """Value that a multiple is taken of."""
    if group == "mass":
        bodies = ["all", *(drivetrain.model.body(k).name for k in range(1, drivetrain.model.nbody))]
        if name not in bodies:
            raise RandomizationError(
                f"{where}: the robot has no body '{name}'{nearest(name, bodies)}; there are {', '.join(bodies)}."
            )
        return 1.0
    words = {**RUNNING, "floor": FLOORS, "gravity": {"strength": 0.0}}.get(group)
    if words is not None and name not in words:
        raise RandomizationError(f"{where}: there is no '{name}'{nearest(name, words)}; there are {', '.join(words)}.")
    if f"{group}.{name}" in OF_BASE and _base(drivetrain) is None:
        raise RandomizationError(f"{where}: the base of the robot is not free, and feels none; leave it out.")
    if group == "gravity":
        return -float(drivetrain.model.opt.gravity[2])
    if group in RUNNING:
        return 0.0
    if group == "centre":
        body, _, axis = name.rpartition(".")
        bodies = [drivetrain.model.body(k).name for k in range(1, drivetrain.model.nbody)]
        if body not in bodies or axis not in ("x", "y", "z"):
            raise RandomizationError(
                f"{where} must be a body and an axis, such as {bodies[0]}.x{nearest(name, [f'{b}.x' for b in bodies])}."
            )
        return 0.0
    if group == "floor":
        if FLOOR not in (drivetrain.model.geom(k).name for k in range(drivetrain.model.ngeom)):
            raise RandomizationError(f"{where}: the robot's model has no geom '{FLOOR}'; leave it out, or add one.")
        return float(drivetrain.model.geom(FLOOR).friction[0]) if name == "friction" else 0.0
    return float(drivetrain.chains[group].value(name))


def _base(drivetrain: Drivetrain) -> tuple[int, int] | None:
    return BaseLayout.of_model(drivetrain.model, range(drivetrain.model.njnt)).base


def _range(value: Any, nominal: float, where: str) -> tuple[float, float]:
    factor = 1.0
    if isinstance(value, Mapping) and set(value) == {"times"}:
        value, factor = value["times"], nominal
    fits = isinstance(value, list | tuple) and len(value) == 2
    if not fits or not all(_is_number(end) for end in value) or value[0] > value[1]:
        raise RandomizationError(f"{where} must be a range [low, high], or {{times: [low, high]}}, not {value!r}.")
    low, high = sorted(float(end) * factor for end in value)
    return low, high


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


# --- many machines of one robot, of which every episode draws one: as a diagnosis leaves it open which of them it is.
#
# chains: {hip: {friction.coulomb: [0.051, 0.049]}}   numbers of the chain of a coordinate, machine by machine
# robot:  {foot_payload: [0.02, 0.05]}                numbers of the robot, machine by machine

KINDS = ("chains", "robot")
Build = Callable[[Mapping[str, Chain], Mapping[str, float]], Drivetrain]
"""Makes the robot with chains, and with numbers in place of those that it has otherwise."""


class Machines:
    """Models of the machines, as what of each differs from the robot's own.

    Attributes:
        count: of the machines.
    """

    def __init__(self, drivetrain: Drivetrain, source: Mapping[str, Any], build: Build) -> None:
        """Build each machine.

        Args:
            drivetrain: of the robot itself.
            source: as in the module's docstring.
            build: makes a machine.

        Raises:
            SealegsError: the source is none, or a machine cannot be built or has another law.
        """
        chains, numbers = _checked(source, drivetrain.chains)
        self.count = len(next(iter((*numbers.values(), *(v for own in chains.values() for v in own.values())))))
        own = drivetrain.model
        self._fields: dict[str, np.ndarray] = {}
        for k in range(self.count):
            driven = dict(drivetrain.chains)
            for name, paths in chains.items():
                for path, values in paths.items():
                    driven[name] = driven[name].with_value(path, values[k])
            model = build(driven, {name: values[k] for name, values in numbers.items()}).model
            if (model.nq, model.nv, model.nu, model.nuserdata) != (own.nq, own.nv, own.nu, own.nuserdata):
                raise SealegsError(
                    f"machine {k + 1} of randomization.machines has other joints or another memory than the robot: "
                    "values must not reach to where a stage does nothing."
                )
            for name in MODEL_FIELDS:
                mine, other = _value(own, name), _value(model, name)
                if not isinstance(mine, np.ndarray) or mine.shape != np.shape(other) or np.array_equal(mine, other):
                    continue
                if name not in self._fields:
                    self._fields[name] = np.repeat(mine[None], self.count, axis=0)
                self._fields[name][k] = other

    def apply(self, batch: Batch, simulations: np.ndarray, random: np.ndarray) -> np.ndarray:
        """Let some simulations be of machines that are drawn by uniform numbers in [0, 1) (m,); which ones (m,)."""
        which = np.minimum((random * self.count).astype(int), self.count - 1)
        for name, values in self._fields.items():
            batch.expand(name)[simulations] = values[which].reshape(len(which), *batch.expand(name).shape[1:])
        return which


def _value(model: Any, name: str) -> Any:
    owner, key = (model.opt, name[4:]) if name.startswith("opt.") else (model, name)
    value = getattr(owner, key, None)
    return value if value is None or isinstance(value, np.ndarray) else np.asarray(value)


def _checked(
    source: Mapping[str, Any], chains: Mapping[str, Chain]
) -> tuple[dict[str, dict[str, list[float]]], dict[str, list[float]]]:
    """Numbers of chains and of the robot, of as many machines each."""
    if not isinstance(source, Mapping) or not source:
        raise SealegsError("randomization.machines must be the folder of a diagnosis, or numbers of chains and robot.")
    for kind in source:
        if kind not in KINDS:
            raise SealegsError(
                f"randomization.machines has no '{kind}'{nearest(kind, KINDS)}; there are chains, robot."
            )
    found, numbers = dict(source.get("chains") or {}), dict(source.get("robot") or {})
    for name in found:
        if name not in chains:
            raise SealegsError(
                f"randomization.machines.chains: the robot drives no '{name}'{nearest(name, chains)}; it drives "
                f"{', '.join(chains)}."
            )
    rows = {f"chains.{name}.{path}": row for name, own in found.items() for path, row in own.items()}
    rows |= {f"robot.{name}": row for name, row in numbers.items()}
    for where, row in rows.items():
        if not (isinstance(row, list | tuple) and row and all(_is_number(value) for value in row)):
            raise SealegsError(f"randomization.machines.{where} must be a list of numbers, one for each machine.")
    if len({len(row) for row in rows.values()}) != 1:
        counts = ", ".join(f"{where} {len(row)}" for where, row in rows.items())
        raise SealegsError(f"randomization.machines must have as many values of each number; there are: {counts}.")
    plain = {name: {path: list(map(float, row)) for path, row in own.items()} for name, own in found.items()}
    return plain, {name: list(map(float, row)) for name, row in numbers.items()}
