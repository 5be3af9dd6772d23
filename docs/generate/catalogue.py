"""Writes docs/catalogue.md from the causes themselves: ``python -m docs.generate.catalogue``."""

from __future__ import annotations

import re
from pathlib import Path

from sealegs.actuators import load_chain
from sealegs.common.markdown import table
from sealegs.envs.hopper.robot import HOPPER
from sealegs.gap.causes.catalogue import catalogue
from sealegs.gap.causes.cause import ROBOT, Cause, Needs
from sealegs.gap.ground.leg_ground import contact_causes
from sealegs.gap.ground.leg_model import LegModel
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.robot.directions import TILT_PARAMETERS
from sealegs.gap.robot.search import SENTENCES

DOCS = Path(__file__).resolve().parents[1]
PAGE = DOCS / "catalogue.md"
CHAINS = ("sts3215", "sv1270tg")
"""Nominal chains whose joints together can have every cause; bounds are those of the first that can."""
FAMILIES = {
    "friction": "Friction",
    "drive": "Drive",
    "transmission": "Transmission",
    "spring": "Spring",
    "load": "Load",
    "contact": "Contact",
    "sensor": "Sensor",
}
HEAD = """# The catalogue of causes

All physical causes that a diagnosis can name, with the parameters that it fits. Bounds are those of the joint `sts3215`
(`spring.stiffness`: of `sv1270tg`); they scale with a joint's stall torque. The unit *factor* means that the parameter
multiplies the number of the nominal model.

Each picture is the one in a report on a simulated bench that hides the effect in its clear size and shares no code with
sealegs (`python -m docs.generate.cause_pictures`). Points are measured, orange is the nominal model, blue the extended
one.

Written by `python -m docs.generate.catalogue` from `gap/causes/`; do not edit.
"""
HEADS = ("parameter", "unit", "lowest", "highest")
PARAMETERS = {"load.tilt": TILT_PARAMETERS}
"""Numbers of the causes that only a whole robot has."""
NEEDS = {
    "free_link": "a link that moves freely (a bench with a known load)",
    "free_motor": "a motor that moves on its own (a bench, or a motor behind a spring)",
    "torque": "a bench; or, on a driven joint, a measured torque",
    "claimed_load": "a load that the sidecar claims to know",
    "temperature_range": "a temperature that changes",
}


def causes() -> dict[str, Cause]:
    """Every cause by its name."""
    found: dict[str, Cause] = {}
    for name in CHAINS:
        for cause in catalogue(JointModel(load_chain(name))):
            found.setdefault(cause.name, cause)
    return found


def page() -> str:
    """The text of docs/catalogue.md."""
    every = causes()
    parts = [HEAD]
    for family, title in FAMILIES.items():
        members = [cause for name, cause in every.items() if name.partition(".")[0] == family]
        parts.append(f"\n## {title}\n")
        parts += [_section(cause) for cause in members]
    parts.append("\n## The whole robot\n\nCauses of the load are also looked for over all joints of a robot together")
    parts.append(
        " ([What joints share](diagnose-your-robot.md#what-joints-share)). One cause is looked for only there:\n"
    )
    parts += [_of_robot(name) for name in ROBOT]
    parts.append(
        "\n## The ground under a robot\n\nThese causes are looked for in the stances of a hopper, and in the walk of "
        "any other robot whose base moves ([how](ground.md)).\n"
    )
    leg = LegModel.of({}, {joint: load_chain(chain) for joint, chain in HOPPER.chains.items()})
    parts += [_section(cause, "a hopper's log with the motion of its base") for cause in contact_causes(leg)]
    return "".join(parts)


def _of_robot(name: str) -> str:
    rows = ((f"`{p.path}`", p.unit, f"{p.low:.3g}", f"{p.high:.3g}") for p in PARAMETERS[name])
    head = f"\n### {name}\n\n{SENTENCES[name]} *A number of the nominal model that is wrong.*\n"
    return f"{head}\n{table(HEADS, rows)}\n\nNeeds: the robot's model file.\n"


def _section(cause: Cause, needs: str | None = None) -> str:
    kind = "A number of the nominal model that is wrong." if cause.error else "An effect that the model lacks."
    rows = [f"\n### {cause.name}\n\n{cause.sentence} *{kind}*\n"]
    bounds: dict[tuple[str, str], list[float]] = {}
    for variant in cause.variants:
        for number in variant:
            factor = number.path.endswith("*")
            key = (number.path.rstrip("*"), "factor" if factor else number.unit)
            bounds.setdefault(key, []).extend((number.low, number.high))
    cells = ((f"`{path}`", unit, f"{min(ends):.3g}", f"{max(ends):.3g}") for (path, unit), ends in bounds.items())
    rows.append(f"\n{table(HEADS, cells)}\n")
    rows.append(f"\nNeeds: {needs or _needs(cause.needs)}.")
    if cause.refuted_by is not None:
        rows.append(f" Refuted by: samples of `{cause.refuted_by.channel}` above the fitted limit.")
    if cause.at_stops:
        rows.append(
            " Refuted by: no goal beyond it, no drive that is off, and no load that leads to it from both sides."
        )
    if cause.degenerates_to is not None:
        rows.append(f" Cannot be told from `{cause.degenerates_to.cause}` where {cause.degenerates_to.where}.")
    rows.append("\n")
    picture = DOCS / "pictures" / "causes" / f"{cause.name}.png"
    if picture.exists():
        rows.append(f"\n![What shows {cause.name}](pictures/causes/{cause.name}.png){{.picture}}\n")
    return "".join(rows)


def _needs(needs: Needs) -> str:
    found = [text for name, text in NEEDS.items() if getattr(needs, name)]
    return "; ".join(found) if found else "any replay"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"Written: {PAGE}: {len(re.findall('^### ', page(), re.MULTILINE))} causes")
