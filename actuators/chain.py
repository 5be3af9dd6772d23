"""Actuation chains as data: reading, checking, changing, writing."""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ..common.documents import DocumentError, read_yaml
from ..common.errors import nearest
from .layout import (
    MAGIC,
    P_COEFFICIENT,
    P_FRICTION_KIND,
    P_HEADER,
    P_LENGTH,
    P_MAGIC,
    P_SCALE,
    P_STATE_SIZE,
    P_TERMS,
    S_HEADER,
)
from .outside import opcode
from .published import bam_file, bam_stages
from .stages import OPCODES, STAGES, ChainError, Quantity, Stage, build_stage, order
from .stages.net import Net
from .stages.parity import Frame

CHECKOUT = Path(__file__).resolve().parent.parent
LIBRARY = CHECKOUT / "configs" / "actuator"
GIVING = ("spring", "compliance", "backlash")
"""Stages in which motor and link turn apart."""


@dataclass(frozen=True)
class Chain:
    """An ordered list of stages from a position goal to the torque on a joint.

    Raises:
        ChainError: stages that do not fit one behind the other, said in one sentence.
    """

    stages: tuple[Stage, ...]
    label: str = "chain"

    def __post_init__(self) -> None:
        quantity = self._told
        before = "the command"
        for stage in self.stages:
            if quantity not in stage.takes:
                raise ChainError(
                    f"{self.label}: stage '{stage.name}' takes {' or '.join(stage.takes)}, "
                    f"but {before} gives {quantity}; {self._remedy()}."
                )
            if stage.gives is not None:
                quantity = stage.gives
            before = f"'{stage.name}' before it"
        if quantity != Quantity.TORQUE:
            raise ChainError(
                f"{self.label}: the chain ends in {quantity}, not in a torque; "
                "add a motor ('dc_motor' behind a 'supply', 'regression', 'ideal' or 'net')."
            )
        names = [stage.name for stage in self.stages]
        for name in set(names):
            if names.count(name) > 1 and not STAGES[name].repeats:
                raise ChainError(f"{self.label}: stage '{name}' stands {names.count(name)} times; it may stand once.")
        if "gear" in names:
            before_gear = [name for name in names[: names.index("gear")] if name != "torque_limit"]
            if before_gear[-1] not in ("dc_motor", "regression"):
                raise ChainError(
                    f"{self.label}: 'gear' must stand directly behind its motor ('dc_motor' or 'regression'), "
                    "with at most a 'torque_limit' of the motor between."
                )
        if "thermal" in names and "dc_motor" not in names:
            raise ChainError(
                f"{self.label}: 'thermal' weakens a 'dc_motor', which the chain lacks; remove it or add the motor."
            )
        last = [name for name in order() if STAGES[name].at_end]
        ends = [name for name in names if name in last]
        if ends != sorted(ends, key=last.index) or names[len(names) - len(ends) :] != ends:
            raise ChainError(
                f"{self.label}: the chain must end in the order {' > '.join(last)}, as far as it has them, "
                f"not {' > '.join(names)}."
            )
        if "spring" in names and "compliance" in names and not self.find("spring").has_coordinate:
            raise ChainError(
                f"{self.label}: a 'spring' and a 'compliance' with nothing between are the same element; remove one, "
                "or give the spring the 'inertia' of what turns between them."
            )
        for stage in self.stages:
            stage.check(self)
            stage.law_values(self)

    def _remedy(self) -> str:
        """What to do about stages that do not fit: another order, or a stage that misses."""
        ordered = [name for name in order() if self.find(name)]
        if ordered != [stage.name for stage in self.stages]:
            return f"put it where it belongs in the order {' > '.join(ordered)}"
        return (
            "a position goal becomes a duty in 'position_p', 'position_pd' or 'position_pi', a speed goal in "
            "'velocity_pi', a duty a voltage in 'supply', a voltage a torque in 'dc_motor'; add what misses"
        )

    # --- reading -----------------------------------------------------------------------------------------------

    def find(self, name: str) -> Any:
        """The first stage of that name, or None."""
        return next((stage for stage in self.stages if stage.name == name), None)

    def quantity_before(self, stage: Stage) -> Quantity:
        """What travels into ``stage``."""
        quantity = self._told
        for other in self.stages:
            if other is stage:
                break
            if other.gives is not None:
                quantity = other.gives
        return quantity

    @property
    def command(self) -> str:
        """What the chain is told, as a column of a log: ``goal``, ``goal_velocity`` or ``torque_command``."""
        return next((stage.command for stage in self.stages if stage.command), "goal")

    @property
    def _told(self) -> Quantity:
        """What travels into the first stage; a commanded torque passes as goals do."""
        return Quantity.SPEED_GOAL if self.command == "goal_velocity" else Quantity.POSITION_GOAL

    def impedance_drive(self) -> Any:
        """The 'ideal' stage that adds a commanded velocity and torque to its goal (MIT mode), or None."""
        ideal = self.find("ideal")
        return ideal if ideal is not None and ideal.feedforward > 0.0 else None

    def gear_ratio(self) -> float:
        """Motor turns per joint turn; 1 where the motor's numbers are given at the joint."""
        gear = self.find("gear")
        return gear.ratio if gear is not None else 1.0

    def magnetisation(self) -> float:
        """Motor constant at the motor's temperature over the one given."""
        thermal = self.find("thermal")
        return thermal.factor(thermal.temperature) if thermal is not None else 1.0

    def armature(self) -> float:
        """Rotor inertia at the joint [kg.m2]."""
        return self.value(rotor) * self.gear_ratio() ** 2 if (rotor := self.rotor()) else 0.0

    def rotor(self) -> str:
        """The rotor's inertia as ``stage.parameter``; empty where no stage has one."""
        having = (stage.name for stage in self.stages if stage.parameters().get("armature", 0.0) > 0.0)
        return next((f"{name}.armature" for name in having), "")

    def gives(self) -> bool:
        """Whether motor and link turn apart: by a spring, by what yields, or by play."""
        return any(self.find(name) is not None for name in GIVING)

    def value(self, path: str) -> float:
        """A parameter by ``stage.parameter``."""
        stage, key = self._locate(path)
        return getattr(stage, key)

    def _locate(self, path: str) -> tuple[Stage, str]:
        name, _, key = path.partition(".")
        stage = self.find(name)
        if stage is None:
            names = [item.name for item in self.stages]
            raise ChainError(f"{self.label} has no stage '{name}'{nearest(name, names)}; it has {', '.join(names)}.")
        if key not in (known := {item.name for item in dataclasses.fields(stage)}):
            raise ChainError(f"stage '{name}' has no parameter '{key}'{nearest(key, known)}.")
        return stage, key

    def __str__(self) -> str:
        return " > ".join(stage.name for stage in self.stages)

    # --- changing ----------------------------------------------------------------------------------------------

    def with_value(self, path: str, value: float) -> Chain:
        """A chain with one parameter (``stage.parameter``) changed."""
        stage, key = self._locate(path)
        changed = dataclasses.replace(stage, **{key: value})
        return dataclasses.replace(self, stages=tuple(changed if item is stage else item for item in self.stages))

    def with_stage(self, stage: Stage) -> Chain:
        """A chain with a stage added where it belongs, or put in place of the one of its name."""
        return dataclasses.replace(self, stages=with_stages(self.stages, [stage]))

    def without_stage(self, name: str) -> Chain:
        """A chain without the stages of that name."""
        return dataclasses.replace(self, stages=tuple(item for item in self.stages if item.name != name))

    def turned(self, zero: float, sign: float) -> Chain:
        """The same drive with its joint's angle counted otherwise: ``new = sign (old - zero)``, goals as well.

        Only an encoder's ticks stay where they were, within one tick.
        """
        if (zero, sign) == (0.0, 1.0):
            return self
        ratio, told_angles = self.gear_ratio(), self.command == "goal"
        goals = [told_angles and self.quantity_before(item) == Quantity.POSITION_GOAL for item in self.stages]
        frames = [Frame(zero, sign, of_goals, ratio) for of_goals in goals]
        turned = (stage.turned(frame) for stage, frame in zip(self.stages, frames, strict=True))
        return dataclasses.replace(self, stages=tuple(turned))

    # --- writing -----------------------------------------------------------------------------------------------

    def to_list(self) -> list[dict[str, Any]]:
        """The chain as its YAML document."""
        return [stage.to_dict() for stage in self.stages]

    def to_yaml(self) -> str:
        """The chain as YAML text, one stage a line."""
        rows = [yaml.safe_dump(row, default_flow_style=True, width=1000, sort_keys=False) for row in self.to_list()]
        return "".join(f"- {row.strip()[1:-1]}\n" for row in rows)

    def program(self) -> np.ndarray:
        """The chain as its law reads it (see :mod:`actuators.layout`), for a coordinate of one joint at addresses 0."""
        head = np.zeros(P_HEADER)
        head[P_MAGIC] = MAGIC
        head[P_TERMS] = 1
        head[P_COEFFICIENT] = 1.0
        head[P_SCALE] = 1.0
        body: list[float] = []
        memory = S_HEADER
        for stage, memory in self._memories():
            for slot, value in stage.header(memory).items():
                head[slot] = value
            if stage.law is not None:
                body += self._record(stage, memory)
            memory += stage.memory_size()
        head[P_FRICTION_KIND] = 1.0 if self.friction_needs_law() else 0.0
        program = np.concatenate([head, body, [0.0]])
        program[P_LENGTH] = len(program)
        program[P_STATE_SIZE] = memory
        return program

    def shares_supply(self) -> bool:
        """Whether its motor draws from a supply that may be one for all drives of a robot."""
        supply = self.find("supply")
        return supply is not None and supply.shared > 0.5 and self.find("dc_motor") is not None

    def address(self, path: str) -> int:
        """Where a number (``stage.parameter``) that a law reads stands in :meth:`program`."""
        name, key = path.split(".")
        at = P_HEADER
        for stage, memory in self._memories():
            if stage.name == name and key in stage.record_names():
                return at + 3 + stage.record_names().index(key)
            if stage.law is not None:
                at += len(self._record(stage, memory))
        raise ChainError(f"{self.label}: no law of its program reads '{path}'.")

    def _memories(self) -> list[tuple[Stage, int]]:
        """Stages of the program, and where the memory of each starts in the state."""
        found, memory = [], S_HEADER
        for stage in self._with_gear_loss().stages:
            found.append((stage, memory))
            memory += stage.memory_size()
        return found

    def _record(self, stage: Stage, memory: int) -> list[float]:
        """What a program says of a stage that has a law."""
        assert stage.law is not None
        values = stage.law_values(self)
        numbers = [values[name] for name in stage.record_names()] + stage.law_tail()
        code = OPCODES.get(stage.law) or opcode(stage.law, stage.name)
        return [code, 3 + len(numbers), memory, *numbers]

    def _with_gear_loss(self) -> Chain:
        """The chain with a friction stage where its law has to start the limit: for a gear's loss, and for meshing."""
        if (self.find("gear") or self.find("meshing")) is None or self.find("friction") is not None:
            return self
        return self.with_stage(STAGES["friction"].neutral())

    def friction_needs_law(self) -> bool:
        """Whether dry friction is more than the constant that the engine knows natively."""
        return any(stage.shapes_dry_friction() for stage in self.stages)


def with_stages(stages: Sequence[Stage], added: Iterable[Stage]) -> tuple[Stage, ...]:
    """Stages with others added where they belong, or put in place of the first of their name."""
    made = list(stages)
    for stage in added:
        at = next((k for k, item in enumerate(made) if item.name == stage.name), None)
        if at is not None:
            made[at] = stage
            continue
        ranks = order()
        rank = ranks.index(stage.name)
        at = next((k for k, item in enumerate(made) if ranks.index(item.name) > rank), len(made))
        made.insert(at, stage)
    return tuple(made)


def listed() -> list[str]:
    """All names in ``configs/actuator``, of chains and of sets, as the help pages list them."""
    return sorted(path.stem for path in LIBRARY.glob("*.yaml"))


def names() -> list[str]:
    """Names of the chains in ``configs/actuator``, without the sets for the joints of one robot."""
    return sorted(path.stem for path in LIBRARY.glob("*.yaml") if isinstance(_read(path), list))


def set_names() -> list[str]:
    """Names of the sets in ``configs/actuator``, which hold a chain for each kind of joint of one robot."""
    return sorted(path.stem for path in LIBRARY.glob("*.yaml") if isinstance(_read(path), Mapping))


def load_chain_set(source: Any) -> dict[str, Chain] | None:
    """The chains of a file that holds several, by pattern of joint names (``"*_knee"``); None for any other source.

    Raises:
        ChainError: unreadable file, or a chain that does not fit together.
    """
    if not isinstance(source, str | Path):
        return None
    path = Path(source) if Path(source).suffix in (".yaml", ".yml") else LIBRARY / f"{source}.yaml"
    if not os.path.isfile(path) or not isinstance(document := _read(path), Mapping):
        return None
    return {str(pattern): _build(stages, str(path), path) for pattern, stages in document.items()}


def load_chain(source: str | Path | Sequence[Any] | Chain) -> Chain:
    """A chain from its name in ``configs/actuator``, the path of a YAML file, or its stages as a list.

    ``bam:<path of a JSON file>`` is a fit that was published with BAM (:mod:`sealegs.actuators.published`).

    Raises:
        ChainError: unknown name, unreadable file, or a chain that does not fit together.
    """
    if isinstance(source, Chain):
        return source
    if isinstance(source, Sequence) and not isinstance(source, str):
        return _build(source, "inline chain", None)
    if not isinstance(source, str | Path):
        raise ChainError(f"an actuator is a name, the path of a YAML file or a list of stages, not {source!r}.")
    if (fit := bam_file(source)) is not None:
        return _build(bam_stages(fit), str(fit), fit)
    path = Path(source)
    if path.suffix not in (".yaml", ".yml"):
        if os.path.isfile(path):
            raise ChainError(f"the actuator {path} is no YAML file; give it the ending .yaml.")
        path = LIBRARY / f"{source}.yaml"
        if not os.path.isfile(path):
            known = listed()
            raise ChainError(
                f"there is no actuator '{source}'{nearest(str(source), known)}; "
                f"give one of {', '.join(known)} or the path of a YAML file."
            )
    document = _read(path)
    if isinstance(document, Mapping):
        raise ChainError(f"{path} holds chains for {', '.join(document)}; put it on a robot that has such joints.")
    return _build(document, str(path), path)


def _read(path: Path) -> Any:
    try:
        return read_yaml(path, f"the actuator {path}")
    except DocumentError as error:
        raise ChainError(f"{error}.") from None


def _build(document: Any, label: str, path: Path | None) -> Chain:
    if isinstance(document, str) or not isinstance(document, Sequence) or not document:
        raise ChainError(f"{label}: a chain is a list of stages, such as '- delay: {{seconds: 0.005}}'.")
    stages = []
    for number, entry in enumerate(document, 1):
        where = f"{label}, stage {number}"
        if isinstance(entry, str):
            entry = {entry: {}}
        if not isinstance(entry, Mapping) or len(entry) != 1:
            raise ChainError(f"{where}: expected one 'name: {{parameters}}', found {entry!r}.")
        ((name, parameters),) = entry.items()
        if name == Net.name and isinstance(parameters, Mapping) and isinstance(parameters.get("file"), str):
            parameters = {**parameters, "file": _net_path(parameters["file"], path)}
        stages.append(build_stage(str(name), parameters, where))
    short = path.stem if path is not None else label
    return Chain(tuple(stages), short)


def _net_path(file: str, chain: Path | None) -> str:
    for base in ([chain.parent] if chain is not None else []) + [Path.cwd(), CHECKOUT]:
        if os.path.isfile(candidate := base / file):
            return str(candidate)
    return file


# --- what a chain says of its servo at the joint: how fast it turns without load, and what it holds when stalled -----

BOUNDLESS = 1e3  # torque limits from here on are none [N.m]


def largest_duty(chain: Chain) -> float:
    """Largest duty that the drive gives."""
    return chain.value("duty_limit.limit") if chain.find("duty_limit") is not None else 1.0


def no_load_speed(chain: Chain) -> float:
    """Speed of the joint at the largest duty without load or friction [rad/s]; infinite where the chain tells none."""
    if chain.find("supply") is not None and (motor := chain.find("dc_motor")) is not None:
        back_emf = motor.back_emf * chain.gear_ratio()
        return largest_duty(chain) * chain.value("supply.volts") / max(back_emf, 1e-6)
    if chain.find("regression") is not None and chain.value("regression.speed_torque") < 0.0:
        speed = largest_duty(chain) * chain.value("regression.duty_torque") / chain.value("regression.speed_torque")
        return abs(speed) / chain.gear_ratio()
    return math.inf


def stall_torque(chain: Chain) -> float:
    """Torque on the joint at the largest duty, at rest and without friction [N.m]; infinite where the chain tells
    none."""
    if chain.find("supply") is not None and (motor := chain.find("dc_motor")) is not None:
        current = largest_duty(chain) * chain.value("supply.volts") / motor.resistance
        return current * motor.motor_constant * chain.gear_ratio()
    if chain.find("regression") is not None and chain.value("regression.speed_torque") < 0.0:
        return abs(largest_duty(chain) * chain.value("regression.duty_torque")) * chain.gear_ratio()
    if chain.find("ideal") is not None and chain.value("ideal.torque_limit") < BOUNDLESS:
        return chain.value("ideal.torque_limit")
    if chain.find("ideal_velocity") is not None and chain.value("ideal_velocity.torque_limit") < BOUNDLESS:
        return chain.value("ideal_velocity.torque_limit")
    return math.inf
