"""The whole loop in one command: excite, log, diagnose, extend, train, deploy, compare.

    sealegs loop                                a virtual machine that hides an effect
    sealegs loop out=runs/loop-1                go on with it after a stop, a crash or a kill
    sealegs loop hw=feetech port=/dev/ttyUSB0   the same on real servos (hw=dynamixel for Dynamixels)

The machine is measured, and the log is diagnosed. One policy learns on the servos as believed, another on the extended
model; both run on the machine and in both models. The result is the gap before and after, printed and drawn in gap.png.
Each step is one of the other commands, and is printed.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from ..common.atomic import fresh, write_text
from ..common.documents import read_json, read_yaml
from ..common.errors import SealegsError, nearest
from ..configs.script import Interrupted

BENCH_LOADS = [{"mass": 0.25, "length": 0.10}, {"mass": 0.5, "length": 0.12}]
"""Numbers of a bench that the excitations are run with: two loads that a person has [kg], [m]."""
PLAIN = ("out", "port", "calibration", "hw.virtual.hidden", "hw.virtual.faults")


def main(arguments: list[str]) -> None:
    """Run every step that is not done yet."""
    from ..configs.compose import compose, split
    from ..envs.robots import get_robot
    from ..hw.machine.own_robot import READERS

    given = split(arguments, PLAIN)
    config = compose("loop", given, readers=READERS)
    config = dict(config) | checked_settings(config)
    seed, steps = config["seed"], config["total_timesteps"]
    robot = get_robot(config["robot"]["name"])
    joints = [item.name for item in robot.coordinates]
    if len(joints) > 1 and robot.file is None:
        raise SealegsError(
            f"robot={config['robot']['name']} has the joints {', '.join(joints)}, and the loop is for one servo on a "
            "bench or a robot of your own: give robot=bench or robot=<its .yaml>, or run deploy, diagnose, train and "
            "evaluate one after the other."
        )
    if config["loads"] is None:
        config["loads"] = BENCH_LOADS if robot.file is None else [{}]
    for load in config["loads"]:
        robot.parameters({**numbers(config), **load})  # says at once that it has no such number
    out = Path(str(config["out"] or fresh(Path("runs"), "loop")))
    out.mkdir(parents=True, exist_ok=True)
    keep(out / "loop.yaml", {key: value for key, value in config.items() if key != "out"})
    machine = machine_arguments(config, given, out)

    try:
        measure(config, out, machine, seed)
        extended = diagnose(config, out, machine, seed)
        chain = given.get("robot.actuator", config["robot"]["actuator"] or "null")  # as given: it may be a mapping
        models = {"nominal": f"actuator={chain}"}
        if extended:
            models["extended"] = f"extended={extended}"
        pages = {}
        for name, model in models.items():
            train(config, out, name, model, steps, seed)
            pages[name] = compare(config, out, name, extended, machine, seed)
    except (Interrupted, KeyboardInterrupt) as stop:
        others = [argument for argument in arguments if not argument.startswith("out=")]
        command = shlex.join(["sealegs", "loop", f"out={out}", *others])
        raise Interrupted(f"{str(stop) or 'Stopped.'} The loop goes on with: {command}") from stop
    tell(out, pages)


def checked_settings(config: Mapping[str, Any]) -> dict[str, Any]:
    """The keys that are the loop's own, each of its type; those of machine and robot are checked where they are used.

    Raises:
        SealegsError: a value of the wrong type or size.
    """
    from ..configs.check import Count, Natural, NotNegative, Positive, checked, or_null
    from ..gap.experiment import library

    known = [name.replace(" ", "_") for name in library(0.0, 1.0, 0)]
    types: dict[str, tuple[Any, str]] = {
        "excitations": (list[str], "excitations={} must be a list of names, such as [chirp,steps]."),
        "loads": (
            or_null(list[dict[str, float]]),
            "loads={} must be a list of numbers of the robot, such as [{{mass:0.25,length:0.1}}], or null.",
        ),
        "hidden": (or_null(dict[str, Any]), "hidden={} must be a mapping, such as {{delay.seconds:0.03}}, or null."),
        "stepped": (bool, ""),
        **dict.fromkeys(("rate", "seconds"), (Positive, "")),
        "reach": (
            or_null(Positive | dict[str, Positive]),
            "reach={} must be a number above 0, numbers by pattern of names such as {{left_finger:0.01}}, or null.",
        ),
        **dict.fromkeys(("silence", "energy_weight"), (NotNegative, "")),
        **dict.fromkeys(("further", "seed"), (Natural, "")),
        "total_timesteps": (Count, ""),
    }
    values = {key: checked(key, config[key], kind, words.format(config[key])) for key, (kind, words) in types.items()}
    for word in values["excitations"]:
        if word not in known:
            raise SealegsError(f"there is no excitation '{word}'{nearest(word, known)}; there are {', '.join(known)}.")
    for key in ("excitations", "loads"):
        if values[key] == []:
            raise SealegsError(f"{key} is an empty list: nothing would be measured.")
    return values


def machine_arguments(config: Mapping[str, Any], given: Mapping[str, str], out: Path) -> list[str]:
    """Arguments by which the other scripts reach the machine.

    Args:
        config: of the loop.
        given: its arguments. Those of the groups ``hw`` and ``robot`` go on as they are, whatever keys a group has: the
            other scripts compose these groups from the same files.
        out: folder for what the virtual machine hides.
    """
    shared = [f"{key}={value}" for key, value in given.items() if key.partition(".")[0] in ("hw", "robot")]
    shared += ["live=false", f"silence={config['silence']}"]
    shared += [f"{key}={config[key]}" for key in ("port", "calibration") if config[key] is not None]
    virtual = config["hw"]["virtual"]
    if virtual is None:
        return shared
    if "hidden" not in virtual:
        hidden = out / "hidden.yaml"
        if not hidden.exists():
            write_text(hidden, yaml.safe_dump(dict(config["hidden"] or {})))
        shared.append(f"hw.virtual.hidden={hidden.resolve()}")
    if "time" not in virtual:
        shared.append(f"hw.virtual.time={'stepped' if config['stepped'] else 'real'}")
    return shared


def numbers(config: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers of the robot other than its own, before a load is put on."""
    return dict(config["robot"].get("params") or {})


def measure(config: Mapping[str, Any], out: Path, machine: list[str], seed: int) -> None:
    """Run each excitation with each load that has no complete log yet."""
    for number, load in enumerate(config["loads"]):
        todo = [word for word in config["excitations"] if not complete(out, f"load{number}_{word}")]
        if todo and load and config["hw"]["virtual"] is None:
            put_on(f"load {number + 1}", load)
        for word in todo:
            excite(config, out, machine, f"load{number}_{word}", word, load, seed + number)


def put_on(name: str, load: Mapping[str, float]) -> None:
    """Ask for a load and wait for it.

    Raises:
        SealegsError: nobody can answer.
    """
    said = ", ".join(f"{key} {value:g}" for key, value in load.items())
    try:
        input(f"\nPut on {name} ({said}) and press Enter. ")
    except EOFError:
        raise SealegsError(
            "the load must be changed by a person, and there is no terminal; run sealegs loop in one."
        ) from None


def excite(
    config: Mapping[str, Any], out: Path, machine: list[str], name: str, word: str, load: Mapping[str, float], seed: int
) -> None:
    """One excitation; its log is ``out/log/<name>.csv``."""
    from . import deploy as script

    params = json.dumps({**numbers(config), **load})
    machine = [argument for argument in machine if not argument.startswith(("robot.params=", "robot.params."))]
    arguments = [f"excitation={word}", f"out={out / 'log'}", f"name={name}", *machine, f"robot.params={params}"]
    arguments += [f"rate={config['rate']}", f"seed={seed}"]
    arguments += [] if config["reach"] is None else [f"reach={json.dumps(config['reach'])}"]
    heading(shlex.join(["sealegs", "deploy", *arguments]))
    script.main(arguments)


def complete(out: Path, name: str) -> bool:
    """Whether a log is there and whole; one that a stop cut short is put aside."""
    from ..hw.run.measured_log import read_events

    log = out / "log" / f"{name}.csv"
    if not log.exists():
        return False
    if any(event["event"] == "end" and event["ending"] == "finished" for event in read_events(log)):
        return True
    aside = out / "unfinished"
    aside.mkdir(exist_ok=True)
    free = fresh(aside, name)
    for ending in (".csv", ".yaml", ".events.jsonl"):
        if (part := out / "log" / f"{name}{ending}").exists():
            part.rename(free.with_name(f"{free.name}{ending}"))
    return False


def diagnose(config: Mapping[str, Any], out: Path, machine: list[str], seed: int) -> Path | None:
    """Explain the log, measuring further where that is proposed; the folder of the extended model, None without."""
    from ..envs.extended import FILE
    from ..gap.log.sidecar import read_sidecar
    from . import diagnose as script

    folder = out / "diagnosis"
    for further in range(config["further"] + 1):
        folder = out / ("diagnosis" if further == 0 else f"diagnosis-{further + 1}")
        if not (folder / "diagnosis.json").exists():  # one that was stopped goes on by itself
            arguments = [f"log={out / 'log'}", f"out={folder}", f"seed={seed}"]
            heading(shlex.join(["sealegs", "diagnose", *arguments]))
            script.main(arguments)
        proposal = folder / "next_experiment.csv"
        if not proposal.exists() or further == config["further"]:
            break
        if not complete(out, f"further{further}"):
            load = read_sidecar(proposal).robot_params
            if config["hw"]["virtual"] is None:
                put_on("the load of the proposed experiment", load)
            excite(config, out, machine, f"further{further}", str(proposal), load, seed)
    return folder if (folder / FILE).exists() else None


def train(config: Mapping[str, Any], out: Path, name: str, model: str, steps: int, seed: int) -> None:
    """Train on a model, or go on with it."""
    from ..envs.described.robot_file import is_robot_file
    from . import train as script

    folder = out / f"policy-{name}"
    if (folder / "final" / "policy.onnx").exists():
        return
    if (folder / "config.yaml").exists():
        arguments = [f"resume={folder}"]
    else:
        put_aside(folder, out)
        name = config["robot"]["name"]
        task = ["env=track", f"robot={name}"] if is_robot_file(name) else [f"env={name}"]
        arguments = [*task, model, f"out={out}", f"name={folder.name}"]
        arguments += [f"seed={seed}", f"total_timesteps={steps}", "video.seconds=0"]
        arguments.append(f"env.energy_weight={config['energy_weight']}")
        if params := numbers(config):
            arguments.append(f"env.params={json.dumps(params)}")
    heading(shlex.join(["sealegs", "train", *arguments]))
    script.main(arguments)


def compare(
    config: Mapping[str, Any], out: Path, name: str, extended: Path | None, machine: list[str], seed: int
) -> Path:
    """Run a policy in all models and on the machine; the folder of the comparison."""
    from . import evaluate as script

    folder = out / f"comparison-{name}"
    if not (folder / "comparison.json").exists():
        put_aside(folder, out)
        arguments = [f"policy={out / f'policy-{name}' / 'final'}", f"out={folder}", f"seconds={config['seconds']}"]
        arguments += [f"seed={seed}", *machine] + ([f"extended={extended}"] if extended else [])
        heading(shlex.join(["sealegs", "evaluate", *arguments]))
        script.main(arguments)
    return folder


def put_aside(folder: Path, out: Path) -> None:
    """Move what a stop left unfinished out of the way."""
    if folder.exists():
        aside = out / "unfinished"
        aside.mkdir(exist_ok=True)
        folder.rename(fresh(aside, folder.name))


def keep(file: Path, config: Mapping[str, Any]) -> None:
    """Write down what the loop runs with; going on with other values is refused."""
    if not file.exists():
        write_text(file, yaml.safe_dump(dict(config), sort_keys=False))
        return
    kept = read_yaml(file)
    if not isinstance(kept, dict):
        raise SealegsError(f"{file}, by which the loop goes on, is damaged; give another out=<folder>.")
    for key, value in config.items():
        if kept.get(key) != value:
            raise SealegsError(
                f"{file.parent} was begun with {key}={kept.get(key)}, and now it is {value}; give another out=<folder>."
            )


def tell(out: Path, folders: Mapping[str, Path]) -> None:
    """Print and draw the gap before and after."""
    from ..evaluation.figures import told_error
    from ..evaluation.pictures import draw_gap

    documents = {name: read_json(folder / "comparison.json") for name, folder in folders.items()}
    heading("What came of it")
    for name, document in documents.items():
        figures = document["figures"]
        gaps = [f"{told_error(figures[model])} in the {model} model" for model in figures if model != "machine"]
        print(f"  Policy trained on the {name} model: {figures['machine']['reward']:.1f} of reward a second there;")
        print(f"    the machine is off by {', by '.join(gaps)}.")
    if "extended" not in folders:
        print(f"  {nothing_found(out)}")
    picture = out / "gap.png"
    if not picture.exists():
        draw_gap(documents, picture)
    print(f"  Picture      {picture}")
    for name, folder in folders.items():
        print(f"  Page         {folder / 'comparison.html'}  (policy of the {name} model)")


def nothing_found(out: Path) -> str:
    """Why there is no extended model, as the last diagnosis of the loop says it."""
    from ..gap.verdict.verdict import NOT_IDENTIFIABLE, UNUSABLE

    files = sorted(out.glob("diagnosis*/diagnosis.json"))
    found = read_json(files[-1]) if files else {"joints": []}
    open_ones = [item for item in found.get("joints", [found]) if item["verdict"] in (NOT_IDENTIFIABLE, UNUSABLE)]
    if not open_ones:
        return "The diagnosis found nothing to extend the model by."
    why = " ".join(reason["sentence"] for reason in open_ones[0]["reasons"]) or open_ones[0]["sentence"]
    return f"The diagnosis could not tell what to extend the model by. {why}"


def heading(text: str) -> None:
    """Title of a step."""
    print(f"\n== {text}", flush=True)
