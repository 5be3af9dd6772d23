"""Writes docs/actuators.md from the stages themselves: ``python -m sealegs.actuators.documentation``."""

from __future__ import annotations

import dataclasses
import inspect
import re

from ..common.markdown import table
from .chain import CHECKOUT, LIBRARY, load_chain, load_chain_set, names, set_names
from .stages import Stage, known_stages, order

PAGE = CHECKOUT / "docs" / "actuators.md"
HEAD = """# Stages and chains

All chains and stages of actuator models, with the parameters of each stage. [The actuation chain](actuation-chain.md)
explains what they are. A chain is a YAML list of stages, in the order in which a command passes through them:

```yaml
{example}```

`load_chain("sts3215")` reads a chain from `configs/actuator`, `load_chain("path/to/chain.yaml")` any other file, and
`load_chain("bam:path/to/fit.json")` a fit of [BAM](https://github.com/Rhoban/bam), models M1 to M6. Every command takes
the same words as `actuator=`. In the YAML, numbers stand without units; the units are those of the tables below. Angles
are in radians.

To put a chain on a joint of a MuJoCo model:

```python
import mujoco
from sealegs.actuators import Drivetrain

leg = mujoco.MjSpec.from_string(
    "<mujoco><worldbody><body><joint name='knee'/><geom size='.1' mass='.2' pos='.1 0 0'/></body></worldbody></mujoco>"
)
drivetrain = Drivetrain(leg, {{"knee": "sts3215"}})
data = mujoco.MjData(drivetrain.model)
data.ctrl[drivetrain.actuator_ids["knee"]] = 0.5  # position goal [rad]
mujoco.mj_step(drivetrain.model, data)
```

The stages of a chain must stand in this order:

```text
{order}
```

Written by `python -m sealegs.actuators.documentation` from `actuators/stages/`; do not edit.

"""


def page() -> str:
    """The text of docs/actuators.md."""
    parts = [HEAD.format(example=(LIBRARY / "sts3215.yaml").read_text(encoding="utf-8"), order=_wrapped(order()))]
    chains = ((f"`{name}`", load_chain(name), _comment(name)) for name in names())
    sets = ((f"`{name}`", ", ".join(f"`{pattern}`" for pattern in load_chain_set(name) or {}), _comment(name))
            for name in set_names())  # fmt: skip
    parts.append(f"## Named chains\n\n{table(('name', 'stages', 'what it models'), chains)}\n")
    parts.append("\nA set holds a chain for each kind of joint of one robot:\n\n")
    parts.append(f"{table(('name', 'joints', 'what it models'), sets)}\n")
    for module in dict.fromkeys(known_stages()[name].__module__ for name in order()):  # one section a file
        parts.append(f"\n## {module.rpartition('.')[2].capitalize()}\n")
        parts += [_stage(stage) for stage in known_stages().values() if stage.__module__ == module]
    return "".join(parts)


def _wrapped(order: tuple[str, ...]) -> str:
    lines, line = [], ""
    for name in order:
        if len(line) + len(name) > 100:
            lines.append(line.rstrip())
            line = ""
        line += f"{name} > "
    return "\n".join([*lines, line.removesuffix(" > ")])


def _comment(name: str) -> str:
    """First sentence of the leading comment of a chain's file."""
    lines = (LIBRARY / f"{name}.yaml").read_text(encoding="utf-8").splitlines()
    text = " ".join(line.removeprefix("#").strip() for line in lines if line.startswith("#"))
    return re.split(r"(?<!Fig)\. |; ", text)[0].rstrip(".:")


def _stage(stage: type[Stage]) -> str:
    takes = " or ".join(stage.takes)
    gives = f"gives {stage.gives}" if stage.gives else "passes it on"
    rows = []
    for item in dataclasses.fields(stage):
        default = "required" if item.default is dataclasses.MISSING else item.default
        if "unit" not in item.metadata:
            rows.append((f"`{item.name}`", "", default, "", "", "path of the net (.npz)"))
            continue
        default = default if isinstance(default, str) else f"{default:g}"
        ends = (f"{item.metadata[end]:g}" for end in ("low", "high"))
        rows.append((f"`{item.name}`", item.metadata["unit"], default, *ends, item.metadata["doc"]))
    about = f"\n### {stage.name}\n\n{inspect.cleandoc(stage.__doc__ or '')}\n\nTakes {takes}, {gives}.\n"
    return f"{about}\n{table(('parameter', 'unit', 'default', 'lowest', 'highest', 'meaning'), rows)}\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
    print(f"Written: {PAGE.relative_to(CHECKOUT)}")
