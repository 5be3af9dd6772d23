"""A machine as a diagnosis left it: chains by joint, numbers of the robot, and what was behind each change.

It is read from a diagnosis folder and put on a robot by :meth:`Extended.chains_on` and :meth:`Extended.params_on`. A
change that the robot at hand cannot take is refused with a sentence that names its cause.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from ..actuators import Chain, load_chain
from ..common.documents import DocumentError, read_json, read_yaml
from ..common.errors import SealegsError, nearest
from .contract import task_of
from .described.robot_file import is_robot_file
from .engine.robot import Robot

LOGGER = logging.getLogger("sealegs")
FILE = "extended-robot.yaml"
DRAWS = "extended-draws.json"
"""Beside it: machines as it may be."""
VERSION = 1
Owner = Literal["chain", "robot", "log"]
"""What a number belongs to: the actuation chain, the rest of the robot, or the log, which misreads the machine."""
CORRECTED = {
    "host.offset": "subtract {after:.4g} from its position",
    "host.scale": "divide its position by {after:.4g}",
}
"""How a log is corrected that reads a joint wrongly, by the number that was found."""


class ExtensionError(SealegsError):
    """A diagnosis that cannot be put on a robot, or a folder that holds none."""


@dataclass(frozen=True)
class Change:
    """A number that the diagnosis changed.

    Attributes:
        joint: joint of the log; ``ground`` for what a leg stands on.
        path: such as ``friction.coulomb`` or ``load.mass_factor``.
        before, after: in the unit of the number.
        cause: that was named for it; empty where it was tuned within its tolerance, or refitted.
        owner: ``log`` for numbers that say how the log reads the machine: the machine has nothing of them, and the log
            is to be corrected.
        refitted: whether it moved up to fivefold without a cause, since that does better than all causes.
    """

    joint: str
    path: str
    before: float
    after: float
    cause: str
    owner: Owner
    refitted: bool = False

    def __str__(self) -> str:
        what = self.cause or ("refitted numbers" if self.refitted else "tuned numbers")
        return f"{what} ({self.path} {self.before:.4g} -> {self.after:.4g})"


@dataclass(frozen=True)
class Mounted:
    """The extended chain of a joint.

    Attributes:
        chain: what drives it.
        file: in the diagnosis folder, by which one of several is chosen.
    """

    chain: Chain
    file: str


@dataclass(frozen=True)
class Draws:
    """Machines as a diagnosed one may be, within what its log tells.

    Attributes:
        numbers: that differ between them, keys of :meth:`Extended.numbers`.
        machines: a value for each of these numbers, machine by machine.
    """

    numbers: tuple[tuple[str, ...], ...] = ()
    machines: tuple[tuple[float, ...], ...] = ()


@dataclass(frozen=True, eq=False)
class Extended:
    """A machine as a diagnosis left it.

    Attributes:
        robot: as the log names it.
        params: numbers of the robot that the log believed, on which the changes act; None where its runs differ.
        chains: of each joint; several where the runs were recorded with different nominal chains.
        changes: everything that differs from the nominal model.
        where: folder of the diagnosis, for messages.
        digest: of the model file that the log named; empty for a robot of the collection, or unknown.
        draws: machines as it may be; None where the diagnosis tells none.
    """

    robot: str
    params: Mapping[str, float] | None
    chains: Mapping[str, Sequence[Mounted]]
    changes: tuple[Change, ...] = ()
    where: str = "the diagnosis"
    chosen: Mapping[str, str] = field(default_factory=dict)
    digest: str = ""
    draws: Draws | None = None

    # --- machines as it may be -----------------------------------------------------------------------------------

    def numbers(self) -> dict[tuple[str, ...], float]:
        """Every number: of chains by joint, place of its file and path, of changes by joint, place and path."""
        found: dict[tuple[str, ...], float] = {}
        for joint, variants in self.chains.items():
            for k, item in enumerate(variants):
                for stage in item.chain.stages:
                    own = stage.parameters().items()
                    found |= {("chain", joint, str(k), f"{stage.name}.{key}"): value for key, value in own}
        return found | {("change", c.joint, str(k), c.path): c.after for k, c in enumerate(self.changes)}

    def machines(self) -> list[Extended]:
        """The machines of :attr:`draws`."""
        return (
            []
            if self.draws is None
            else [
                self.with_numbers(dict(zip(self.draws.numbers, values, strict=True))) for values in self.draws.machines
            ]
        )

    def with_numbers(self, values: Mapping[tuple[str, ...], float]) -> Extended:
        """The machine with other values for some of its :meth:`numbers`.

        Raises:
            ExtensionError: it has no such number.
        """
        changes = list(self.changes)
        chains = {joint: list(variants) for joint, variants in self.chains.items()}
        try:
            for (kind, joint, place, path), value in values.items():
                k = int(place)
                if kind == "change":
                    changes[k] = replace(changes[k], after=value)
                else:
                    chains[joint][k] = replace(chains[joint][k], chain=chains[joint][k].chain.with_value(path, value))
        except (LookupError, ValueError):
            raise ExtensionError(f"{self.where}: its draws are of another model; diagnose again.") from None
        return replace(self, changes=tuple(changes), chains=chains, draws=None)

    # --- on a robot --------------------------------------------------------------------------------------------

    def chains_on(self, robot: Robot) -> dict[str, Chain]:
        """A chain for each coordinate of ``robot`` that was diagnosed; a servo alone is taken for all coordinates.

        Raises:
            ExtensionError: a joint is none of the robot's, or has several chains and none was chosen; or the robot is
                another one than that of the log.
        """
        self._check_model(robot)
        names = [item.name for item in robot.coordinates]
        chains = {joint: self._chain(joint) for joint in self.chains}
        if len(chains) == 1 and (
            not robot.is_called(self.robot) or len(names) == 1
        ):  # a log may call its joint anything
            return dict.fromkeys(names, *chains.values())
        for joint in chains:
            if joint not in names:
                raise ExtensionError(
                    f"{self.where} is of robot '{self.robot}' with the joints {', '.join(chains)}, and robot "
                    f"'{robot.name}' has no '{joint}'{nearest(joint, names)}; give actuator={{<joint>: <chain>}} with "
                    "the files of single joints."
                )
        return chains

    def _check_model(self, robot: Robot) -> None:
        """Refuse the diagnosis of a robot on another one; of a model that was changed since, say so."""
        if robot.file is None or robot.file.model.digest == self.digest:
            return
        if not self.digest:  # a diagnosis of before, or of a robot of the collection
            if not robot.is_called(self.robot):
                LOGGER.warning(
                    "%s", f"{self.where} is of robot '{self.robot}'; it is put on '{robot.name}' all the same."
                )
            return
        if not robot.is_called(self.robot):
            raise ExtensionError(
                f"{self.where} is of robot '{self.robot}', and '{robot.file.model.path.name}' is another model; "
                f"diagnose that robot{self._chains_alone()}."
            )
        LOGGER.warning(
            "%s", f"{robot.file.model.path.name} was changed after {self.where} was written; diagnose again to be sure."
        )

    def params_on(
        self, robot: Robot, params: Mapping[str, float] | None = None, *, told: bool = True
    ) -> dict[str, float]:
        """Numbers of ``robot``, as believed and with everything that was found.

        What was tuned within its tolerance and is no number of this robot is left out, and told.

        Args:
            robot: at hand.
            params: numbers believed of it, in place of those of the log.
            told: whether what is left out is told.

        Raises:
            ExtensionError: the robot has no number that could take a finding.
        """
        same = robot.is_called(self.robot)
        believed = {**(self.params or {} if same else {}), **(params or {})}
        values, refused, left_out = robot.parameters(believed), {}, []
        for change in self.changes:
            if change.owner != "robot":
                continue
            of_joint = robot.effects.get(f"{change.joint}.{change.path}", robot.effects.get(change.path))
            effect = of_joint if same else None
            if effect is not None:
                values[effect.number] = effect.on(values[effect.number], change.after)
                believed[effect.number] = values[effect.number]
            elif change.cause or change.refitted:
                refused.setdefault(change.cause or change.path, change)
            else:
                left_out.append(change)
        if refused:
            raise ExtensionError(self._refusal(robot, list(refused.values())))
        if left_out and told:
            LOGGER.warning("%s", self._left_out(robot, left_out))
        return {name: value for name, value in robot.parameters(believed).items() if name in believed}

    def check_log(self) -> None:
        """Make sure that the log read the machine rightly: no simulation can take how it did not.

        Raises:
            ExtensionError: a reading of the log was found to be wrong; says how to correct it.
        """
        misread = [c for c in self.changes if c.path in CORRECTED and (c.cause or c.refitted)]
        if not misread:
            return
        rows = ", ".join(f"{change} at joint '{change.joint}'" for change in misread)
        mended = "; ".join(f"{c.joint}: {CORRECTED[c.path].format(after=c.after)}" for c in misread)
        raise ExtensionError(
            f"{self.where} found {rows}, which cannot be applied: it is how the log reads the joint, and neither the "
            f"actuator nor the robot has it; correct the log ({mended}) or calibrate the joint and record again, then "
            f"diagnose again{self._chains_alone()}."
        )

    def _chains_alone(self) -> str:
        """How the actuators of the diagnosis are taken without the rest of it."""
        named = {joint: variants[0].file for joint, variants in self.chains.items()}
        files = {joint: f"{self.where}/{file}" for joint, file in named.items() if file}
        if not files:
            return ""
        given = ",".join(f"{joint}:{file}" for joint, file in files.items())
        alone = next(iter(files.values())) if len(files) == 1 else f"{{{given}}}"
        return f"; or give actuator={alone} for the actuators alone"

    def _left_out(self, robot: Robot, left_out: Sequence[Change]) -> str:
        rows = ", ".join(f"{c.path} {c.before:.4g} -> {c.after:.4g}" for c in left_out)
        count = f"{len(left_out)} numbers" if len(left_out) > 1 else "one number"
        return f"{self.where} tuned {count} within tolerance that robot '{robot.name}' has not; left out: {rows}."

    def _refusal(self, robot: Robot, refused: Sequence[Change]) -> str:
        rows = ", ".join(str(change) for change in refused)
        several = len(refused) > 1
        why = (
            f"robot '{robot.name}' has no number for {'them' if several else 'it'}"
            if robot.is_called(self.robot)
            else f"{'they are' if several else 'it is'} of robot '{self.robot}', not of robot '{robot.name}'"
        )
        remedy = self._chains_alone().removeprefix("; or ") or "put it into the robot's model"
        return f"{self.where} found {rows}, which cannot be applied: {why}; {remedy}."

    def _chain(self, joint: str) -> Chain:
        variants = self.chains[joint]
        if joint in self.chosen:
            return next(item.chain for item in variants if item.file == self.chosen[joint])
        if len(variants) > 1:
            files = " or ".join(f"extended={self.where}/{item.file}" for item in variants)
            raise ExtensionError(
                f"{self.where} has {len(variants)} chains for joint '{joint}', since its runs were recorded with "
                f"different nominal chains; choose one: {files}."
            )
        return variants[0].chain

    # --- on disk -----------------------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """As plain data, the form of :data:`FILE`."""
        return {
            "version": VERSION,
            "robot": self.robot,
            **({"model": self.digest} if self.digest else {}),
            "params": None if self.params is None else dict(self.params),
            "chains": {
                joint: [{"file": item.file, "stages": item.chain.to_list()} for item in variants]
                for joint, variants in self.chains.items()
            },
            "changes": [dict(vars(change)) for change in self.changes],
        }

    @classmethod
    def from_dict(cls, document: Mapping[str, Any], where: str = "the diagnosis") -> Extended:
        """From plain data.

        Raises:
            SealegsError: it is damaged.
        """
        try:
            if document["version"] != VERSION:
                raise ExtensionError(f"{where}: its version is {document['version']}, not {VERSION}; diagnose again.")
            return cls(
                robot=str(document["robot"]),
                params=None if document["params"] is None else dict(document["params"]),
                chains={
                    str(joint): tuple(Mounted(load_chain(item["stages"]), str(item["file"])) for item in variants)
                    for joint, variants in document["chains"].items()
                },
                changes=tuple(Change(**change) for change in document["changes"]),
                where=where,
                digest=str(document.get("model") or ""),
            )
        except (LookupError, TypeError, AttributeError) as error:
            raise ExtensionError(f"{where}: cannot be read ({error}); diagnose again.") from None


def read_extended(path: str | Path) -> Extended:
    """The machine of a diagnosis folder; a chain file in it chooses that one of several.

    Raises:
        ExtensionError: the folder is no diagnosis, or one without an extended model.
    """
    path = Path(path)
    folder = path.parent if path.suffix in (".yaml", ".yml") else path
    try:
        document = read_yaml(folder / FILE)
    except DocumentError as error:
        raise ExtensionError(_missing(path, folder) if error.missing else f"{error}; diagnose again.") from None
    extended = Extended.from_dict(document, str(folder))
    if (folder / DRAWS).is_file():
        extended = replace(extended, draws=_read_draws(folder / DRAWS))
    if is_robot_file(extended.robot):  # named as it lies beside the folder
        extended = replace(extended, robot=str((folder / extended.robot).resolve()))
    if path == folder or path.name == FILE:
        return extended
    chosen = {joint: path.name for joint, variants in extended.chains.items() for v in variants if v.file == path.name}
    if not chosen:
        known = [item.file for variants in extended.chains.values() for item in variants]
        raise ExtensionError(
            f"{folder} has no chain {path.name}{nearest(path.name, known)}; it has {', '.join(known)}."
        )
    return Extended(**{**vars(extended), "chosen": chosen})


def with_machines(source: Any, name: str, params: Mapping[str, float] | None = None, robot: str | None = None) -> Any:
    """A randomisation with the machines of a diagnosis as numbers of the robot, where it names one.

    Args:
        source: folder of a diagnosis, or an :class:`Extended`, alone or as ``machines`` of a randomisation; anything
            else stays.
        name: id of the environment.
        params: numbers believed of the robot.
        robot: of an environment that takes any.

    Raises:
        SealegsError: it tells no machines, or the robot cannot take them.
    """
    if isinstance(source, Mapping):
        inner = source.get("machines")
        return {**source, **with_machines(inner, name, params, robot)} if names_diagnosis(inner) else source
    if not names_diagnosis(source):
        return source
    machine = source if isinstance(source, Extended) else read_extended(source)
    machine.check_log()
    if machine.draws is None or not machine.draws.machines:
        raise ExtensionError(
            f"{machine.where} holds no machines to draw from: it was written by an earlier version; diagnose again."
        )
    found = task_of({"id": name} if robot is None else {"id": name, "robot": robot})[0].robot
    rows = [(one.chains_on(found), one.params_on(found, params, told=False)) for one in machine.machines()]
    chains = {
        joint: {f"{stage.name}.{key}": [] for stage in chain.stages for key in stage.parameters()}
        for joint, chain in rows[0][0].items()
    }
    for joint, own in chains.items():
        for path, values in own.items():
            values.extend(float(one[joint].value(path)) for one, _ in rows)
    numbers = {key: [float(one[key]) for _, one in rows] for key in rows[0][1]}
    varying = {joint: {path: v for path, v in own.items() if len(set(v)) > 1} for joint, own in chains.items()}
    kept = {joint: own for joint, own in varying.items() if own}
    return {"machines": {"chains": kept, "robot": {key: v for key, v in numbers.items() if len(set(v)) > 1}}}


def names_diagnosis(source: Any) -> bool:
    """Whether a randomisation is that of a diagnosis: its folder, or what it found."""
    return isinstance(source, Extended) or (isinstance(source, str | Path) and Path(source).is_dir())


def write_draws(draws: Draws, path: Path) -> None:
    """Write machines as a diagnosed one may be, a line each."""
    rows = ",\n  ".join(json.dumps([float(f"{value:.6g}") for value in values]) for values in draws.machines)
    numbers = ",\n  ".join(json.dumps(key) for key in draws.numbers)
    text = f'{{"version": {VERSION},\n "numbers": [\n  {numbers}],\n "machines": [\n  {rows}]}}\n'
    path.write_text(text, encoding="utf-8")


def _read_draws(path: Path) -> Draws:
    try:
        document = read_json(path)
        numbers = tuple(tuple(map(str, key)) for key in document["numbers"])
        machines = tuple(tuple(map(float, values)) for values in document["machines"])
        if document["version"] == VERSION and all(len(values) == len(numbers) for values in machines):
            return Draws(numbers, machines)
    except (DocumentError, LookupError, TypeError, ValueError):
        pass
    raise ExtensionError(f"{path} is damaged; diagnose again.")


def extended_arguments(
    name: str,
    extended: Extended | str | Path,
    actuator: Any = None,
    params: Mapping[str, float] | None = None,
    robot: str | None = None,
) -> tuple[dict[str, Any], dict[str, float]]:
    """Chains by joint and numbers of the robot of an environment, as a diagnosis found them.

    Raises:
        SealegsError: a chain is given too, or neither robot nor simulation can take what was found.
    """
    machine = extended if isinstance(extended, Extended) else read_extended(extended)
    if actuator is not None:
        raise ExtensionError("actuator= and extended= both say which chain drives the robot; give one of them.")
    machine.check_log()
    found = task_of({"id": name} if robot is None else {"id": name, "robot": robot})[0].robot
    return dict(machine.chains_on(found)), machine.params_on(found, params)


def _missing(path: Path, folder: Path) -> str:
    if not folder.is_dir():
        return f"extended={path}: there is no such folder; give the folder that sealegs diagnose wrote."
    if not (folder / "diagnosis.json").is_file():
        return f"extended={path}: {folder} holds no diagnosis; give the folder that sealegs diagnose wrote."
    if any(folder.glob("*extended*.yaml")):
        return f"{folder} was written before robots could be extended; diagnose again, or give actuator=<its chain>."
    return f"{no_model(str(folder))[:-1]} (see its report.html)."


def no_model(where: str) -> str:
    """The sentence for a diagnosis that has no model to hand over."""
    return f"{where} holds no extended model: its diagnosis could not say what the machine is."
