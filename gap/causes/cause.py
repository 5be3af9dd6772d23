"""What a cause is: all of it in fields, nothing in its name."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...common.errors import SealegsError
from ..replay.joint_model import JointModel
from ..replay.parameters import HasNumbers, Parameter, absolute, address, factor

Variant = tuple[Parameter, ...]
"""One way in which a cause acts: the parameters that it turns, the one that makes it act first."""


@dataclass(frozen=True)
class View:
    """What a replay of a log can show.

    Attributes:
        free_link: the link moves as the torques on it say, not as it was measured.
        free_motor: the motor does, on its own or with a free link.
        columns: logged columns that are compared.
    """

    free_link: bool = True
    free_motor: bool = True
    columns: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Needs:
    """What a cause needs for a replay to show it.

    Attributes:
        free_link: a link that moves as the torques on it say: the cause is of what is behind it.
        free_motor: a motor that moves on its own: a prescribed position does not show the cause.
        torque: where the motor's motion is prescribed, a measured torque.
        claimed_load: a load that somebody claims to know; nobody can be wrong about one that is unknown.
        temperature_range: a temperature that changes.
        dry_friction: of the nominal model or found before: alone, what modulates it would be friction at some angles.
    """

    free_link: bool = False
    free_motor: bool = False
    torque: bool = False
    claimed_load: bool = False
    temperature_range: bool = False
    dry_friction: bool = False

    def met_by(self, view: View) -> bool:
        """Whether a replay can show it; the temperature is up to the log."""
        if self.free_link and not view.free_link:
            return False
        prescribed = self.free_motor or (self.torque and "torque" not in view.columns)
        return view.free_motor or not prescribed


@dataclass(frozen=True)
class Ceiling:
    """A refutation: a column that cannot exceed a fitted number if the cause is there.

    Attributes:
        channel: the column.
        number: the limit, by ``owner.key``.
        margin: times the limit that rounding of the column may reach.
    """

    channel: str
    number: str
    margin: float = 1.004

    def exceeded(self, column: np.ndarray, fits: Sequence[Mapping[str, float]], nominal: HasNumbers) -> float:
        """Share of the samples (n,) that are above the lowest of the fitted limits."""
        limit = min(absolute(values, nominal)[self.number] for values in fits)
        return float(np.mean(np.abs(column) > limit * self.margin))


@dataclass(frozen=True)
class Limit:
    """Where a cause degenerates: data of that kind cannot tell it from another.

    Attributes:
        cause: name of the other.
        where: what the data are like.
        edge: a number of the cause; where it is at its upper bound, the other cause is meant.
        by_speed: the same where it is beyond all speeds of the log.
        by_range: it counts periods per turn, and the other cause is meant where the joint visits too little of one.
    """

    cause: str
    where: str
    edge: str = ""
    by_speed: bool = False
    by_range: bool = False


@dataclass(frozen=True)
class Cause:
    """One entry of the catalogue.

    Attributes:
        sentence: for people.
        picture: which picture shows it (:mod:`sealegs.gap.output.pictures`).
        variants: ways in which it may act, its usual form first; the one that explains more is taken.
        error: whether it is a wrong number of the nominal model, not an effect that the model lacks.
        of_column: whether it is a fault of a column of the log, and nothing of the machine.
        needs: what a replay must have to show it.
        refuted_by: what in a log shows that it is not there.
        degenerates_to: the cause that it cannot be told from in poorer data.
        name: as in ``diagnosis.json``.
        about: body of a robot that it is of, where several causes of a search have one name.
        seen: whether it was read off the log, so that every round tries it.
        at_stops: whether it acts at stops, so that those that were read off the log are its first form.
        against: signal that the nominal model's error depends on where the cause is present: a quantity of the picture
            ``response``, or the column that shows a cause of the ground best.
        plausible: size by path at which it ought to show, so that finding none of it means something.
        at_motor: its form on the motor's side of what gives between motor and link, which is the usual one and no other
            law as long as nothing gives; None where it has none.
        signature: key of the features in which the extended model must agree with the measurement before the cause is
            certain (:mod:`sealegs.gap.measure.signatures`); empty where none is known.
    """

    sentence: str
    picture: str
    variants: tuple[Variant, ...]
    error: bool = False
    needs: Needs = Needs()
    refuted_by: Ceiling | None = None
    degenerates_to: Limit | None = None
    name: str = ""
    about: str = ""
    seen: bool = False
    at_stops: bool = False
    signature: str = ""
    of_column: bool = False
    against: str = "speed"
    at_motor: Variant | None = None
    plausible: Mapping[str, float] = field(default_factory=dict, hash=False)

    @property
    def key(self) -> str:
        """What tells it from the other causes of a search: the name, with the body where it is of one."""
        return f"{self.name} ({self.about})" if self.about else self.name

    @property
    def kind(self) -> str:
        """Fault of the ``data``, wrong ``number`` of the model, or ``effect`` that the model lacks."""
        return "data" if self.of_column else "number" if self.error else "effect"

    @property
    def forms(self) -> list[Variant]:
        """Of the variants that begin with one number the first, as each is another law."""
        return list({variant[0].number: variant for variant in reversed(self.variants)}.values())[::-1]

    def edge(self, variant: Variant) -> Parameter | None:
        """The parameter of a variant that tells where the cause is the one that it degenerates to."""
        limit = self.degenerates_to
        return None if limit is None else next((p for p in variant if p.number == limit.edge), None)

    def is_usual(self, variant: Variant) -> bool:
        """Whether a variant turns the parameters of the usual form, from whatever start.

        Another law, such as friction with the square of the load, fits more and extrapolates worse.
        """
        return variant == self.at_motor or {p.path for p in variant} == {p.path for p in self.variants[0]}

    def parted(self) -> Cause:
        """The cause where something gives between motor and link: on either side of it."""
        return self if self.at_motor is None else replace(self, variants=(*self.variants, self.at_motor))


def visible(causes: Sequence[Cause], view: View) -> tuple[list[Cause], list[str]]:
    """Causes that a replay can show, and names of those that it cannot."""
    shown = [cause for cause in causes if cause.needs.met_by(view)]
    return shown, [cause.name for cause in causes if not cause.needs.met_by(view)]


# --- where the families put their causes, and what their entries share -----------------------------------------------

Applies = Callable[[JointModel], bool]
Make = Callable[[JointModel], Cause]


@dataclass(frozen=True)
class Entry:
    """One entry: the name of the cause, which joints can have it, and the cause of such a joint."""

    name: str
    applies: Applies
    make: Make

    def cause(self, nominal: JointModel) -> Cause:
        """The cause of a joint that can have it."""
        cause, axis = self.make(nominal), nominal.axis
        variants = tuple(tuple(axis.scaled(parameter) for parameter in variant) for variant in cause.variants)
        return replace(cause, name=self.name, variants=variants)


ENTRIES: dict[str, Entry] = {}
"""Causes of a joint by name, in the order of the catalogue."""
GROUND = ("contact.friction", "contact.stiffness", "contact.slope")
"""Names of the causes of the ground under a leg (:mod:`sealegs.gap.ground.causes`)."""
ROBOT = ("load.tilt",)
"""Names of the causes that only a whole robot has (:mod:`sealegs.gap.robot.search`)."""


def always(nominal: JointModel) -> bool:
    """Any joint can have it."""
    del nominal
    return True


def entry(name: str, applies: Applies = always) -> Callable[[Make], Make]:
    """Function decorator: add a cause to the catalogue.

    Args:
        name: of the cause, which the function leaves out.
        applies: whether a nominal joint can have it.

    Raises:
        SealegsError: another function has entered that name.
    """

    def add(make: Make) -> Make:
        other = ENTRIES[name].make if name in ENTRIES else make
        if (other.__module__, other.__qualname__) != (make.__module__, make.__qualname__):
            raise SealegsError(
                f"the catalogue has a cause '{name}' already, in {other.__module__}; give the one in {make.__module__} "
                "another name."
            )
        ENTRIES[name] = Entry(name, applies, make)
        return make

    return add


def has(*stages: str) -> Applies:
    """The chain has all of these stages."""
    return lambda nominal: all(nominal.chain.find(stage) is not None for stage in stages)


def has_any(*stages: str) -> Applies:
    """The chain has one of these stages."""
    return lambda nominal: any(nominal.chain.find(stage) is not None for stage in stages)


def lacks(*stages: str) -> Applies:
    """The chain has none of these stages."""
    return lambda nominal: not has_any(*stages)(nominal)


def impedance(nominal: JointModel) -> bool:
    """The drive is told a velocity and a torque beside its goal, and gains that its host knows."""
    return nominal.chain.impedance_drive() is not None


def follows_goals(nominal: JointModel) -> bool:
    """What the drive is told is a goal, which something may shape."""
    return not impedance(nominal) and lacks("torque_command")(nominal)


def follows_positions(nominal: JointModel) -> bool:
    """What the drive is told is a position, to which a profile may lead."""
    return follows_goals(nominal) and nominal.command == "goal"


def both(*conditions: Applies) -> Applies:
    """All of these conditions hold."""
    return lambda nominal: all(condition(nominal) for condition in conditions)


def number(nominal: JointModel, path: str, unit: str, low: float, high: float, start: float, scale: float) -> Parameter:
    """A parameter as a factor where the nominal model has it, else as a value."""
    known = nominal.chain.find(address(path).owner) is not None and nominal.value(path) > 0.0
    value = nominal.value(path) if known else 0.0
    if known and low < value < high:
        return factor(path, max(low / value, 0.02), min(high / value, 50.0), 0.15)
    return Parameter(path, unit, low, high, start, scale)


def alone(parameter: Parameter, *starts: float) -> tuple[Variant, ...]:
    """Ways in which a parameter acts alone, from each of several starts."""
    return tuple((replace(parameter, start=start),) for start in starts)


def stall_torque(nominal: JointModel) -> float:
    """Stall torque of the joint [N.m], or the largest that was commanded: the yardstick for starts and bounds."""
    chain = nominal.chain
    motor, supply = chain.find("dc_motor"), chain.find("supply")
    if motor is not None and supply is not None:
        return chain.gear_ratio() * motor.motor_constant * supply.volts / motor.resistance
    if (regression := chain.find("regression")) is not None:
        return abs(regression.duty_torque) * chain.gear_ratio()
    if (ideal := chain.find("ideal")) is not None:
        if impedance(nominal) and nominal.axis.effort:
            return nominal.axis.effort
        return min(ideal.torque_limit, ideal.stiffness * nominal.axis.reach * math.pi / 4)
    return nominal.axis.effort or 1.0
