"""Write the YAML of a robot beside its MJCF or URDF: which joints are driven, by what, and whose numbers count.

    sealegs new-robot my_arm.xml                      writes my_arm.yaml
    sealegs new-robot my_arm.xml out=robots/arm.yaml  elsewhere
    sealegs new-robot my_arm.xml chain=sts3215        with this chain on every joint

Read what it says, edit the file, and give it to the other commands: robot=my_arm.yaml. A file is never overwritten.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from ..common.errors import SealegsError, nearest

KEYS = ("out", "chain")


def main(arguments: list[str]) -> None:
    """Write the file that the command line names."""
    from ..envs.new_robot.robot_yaml import write_robot_yaml
    from ..gap.log.types import OTHER
    from ..hw.bus.registers import model_of_chain
    from ..hw.machine.assumed_limits import assumed_limits

    files = [argument for argument in arguments if "=" not in argument]
    given = dict(argument.split("=", 1) for argument in arguments if "=" in argument)
    for key in given:
        if key not in KEYS:
            raise SealegsError(f"there is no key '{key}'{nearest(key, KEYS)}; there are out= and chain=.")
    if len(files) != 1:
        raise SealegsError("name one model: sealegs new-robot my_arm.xml (an MJCF or URDF).")
    model = Path(files[0])
    if not files[0] or model.is_dir():
        raise SealegsError(
            f"'{files[0]}' is a folder; name the model in it: sealegs new-robot my_arm.xml (an MJCF or URDF)."
        )
    out = Path(given.get("out") or model.with_suffix(".yaml"))
    said = write_robot_yaml(model, out, given.get("chain"), OTHER, assumed_limits, model_of_chain)
    for sentence in together(said):
        print(f"  {sentence}")
    print(f"Written: {out}. Read it, edit it, and give it as robot={out}.")


# --- what is said of many joints alike, in one sentence --------------------------------------------------------------

MANY = 3  # joints, from which on one sentence speaks of all
OF_A_JOINT = re.compile(r"^((?:Warning: )?)joint (.+?): (.*)$", re.DOTALL)
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)")


def together(said: Sequence[str]) -> list[str]:
    """Sentences; those that differ in the joint and in numbers alone are one, with numbers from least to largest."""
    groups: dict[tuple[str, str], list[tuple[str, list[str]]]] = {}
    keys: list[tuple[str, str]] = []
    for sentence in said:
        match = OF_A_JOINT.match(sentence)
        key = (match[1], NUMBER.sub("{}", match[3].replace("{", "{{").replace("}", "}}"))) if match else ("", sentence)
        keys.append(key)
        groups.setdefault(key, []).append((match[2], NUMBER.findall(match[3])) if match else ("", []))
    found, told = [], set()
    for key, sentence in zip(keys, said, strict=True):
        rows = groups[key]
        if len(rows) < MANY or not rows[0][0]:
            found.append(sentence)
        elif key not in told:
            told.add(key)
            spans = [_span(column) for column in zip(*(numbers for _, numbers in rows), strict=True)]
            names = ", ".join(name for name, _ in rows)
            found.append(f"{key[0]}joints {names}: {key[1].format(*spans)}")
    return found


def _span(numbers: Sequence[str]) -> str:
    low, high = min(numbers, key=float), max(numbers, key=float)
    return low if float(low) == float(high) else f"{low} to {high}"
