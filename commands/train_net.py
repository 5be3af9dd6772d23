"""Train an actuator net: history of position error and speed to torque.

    sealegs train-net log=logs/leg_servo          from measured logs with a torque column
    sealegs train-net log=logs/xl330 rate=200     without one: from the motion of the bench's known load
    sealegs train-net actuator=sts3215            from simulated runs of a chain
    sealegs train actuator=runs/<folder>/chain.yaml

Some runs are held out as a test. The net's file stores the sample rate, which is checked when a chain loads it. At run
time a counter says how many inputs left the training range. Ctrl-C ends the training and keeps the best net so far.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from ..actuators.gravity import GRAVITY
from ..common.atomic import fresh
from ..common.errors import SealegsError, nearest
from ..configs.script import Interrupted

if TYPE_CHECKING:
    from ..actuators.net_training import Settings, TrainedNet, TrainingRun
    from ..gap.log import MeasuredRun


def main(arguments: list[str]) -> None:
    """Collect runs, train, write."""
    from ..actuators.net_report import report
    from ..actuators.net_training import require_torch  # here, so that --help does not wait
    from ..configs.compose import compose, split

    config = compose("train_net", split(arguments, plain=("log", "joint", "actuator", "out"), first="log"))
    if (config["log"] is None) == (config["actuator"] is None):
        raise SealegsError("give either log=<file or folder> or actuator=<chain to learn from simulated runs>.")
    settings = _settings(config)
    require_torch().set_num_threads(1)  # more rarely pays for a net this small
    if config["log"] is not None:
        source = str(config["log"])
        runs, behind = _measured(config), ()
    else:
        runs, behind, source, armature = _simulated(config)
        config["armature"] = armature
    out = Path(str(config["out"] or fresh(Path("runs"), f"net-{Path(source).stem}")))
    try:
        out.mkdir(parents=True)
    except FileExistsError:
        raise SealegsError(f"{out} exists already and nothing is overwritten; give another folder with out=.") from None
    try:
        trained = _train(runs, settings)
    except BaseException as error:
        out.rmdir()  # nothing came of it, and the same out= is free for the next attempt
        if isinstance(error, KeyboardInterrupt):
            raise Interrupted("Stopped before the first epoch was done; there is no net yet.") from None
        raise
    armature = config["armature"] if config["armature"] is not None else runs[0].armature
    report(trained, out, float(armature), behind, source)
    if trained.stopped:
        raise Interrupted(f"Stopped after {trained.epochs} epochs; the best net so far is in {out}.")


def _settings(config: dict[str, Any]) -> Settings:
    from annotated_types import MinLen

    from ..actuators.net_training import Settings
    from ..configs.check import Count, Natural, NotNegative, Positive, Share, checked, or_null

    types: dict[str, tuple[Any, str]] = {
        **dict.fromkeys(("history", "epochs", "patience"), (Count, "it must be at least 1")),
        **dict.fromkeys(("window", "learning_rate"), (NotNegative, "it must be at least 0")),
        "seed": (Natural, "it must be at least 0"),
        "validation": (Share, "it is a share of the runs between 0 and 1"),
        "hidden": (
            Annotated[tuple[Count, ...], MinLen(1)],
            "it is a list of layer sizes, such as [32,32]",
        ),
        "rate": (or_null(Positive), "it must be positive"),
    }
    return Settings(
        **{
            key: checked(key, config[key], kind, f"{key} is {config[key]}; {words}.")
            for key, (kind, words) in types.items()
        }
    )


def _simulated(config: dict[str, Any]) -> tuple[list[TrainingRun], tuple, str, float]:
    """Simulated runs of a chain, the stages that stay behind the net, its name and its armature [kg.m2]."""
    from ..actuators.chain import load_chain
    from ..actuators.net_data import BEHIND, simulated_runs
    from ..configs.check import Positive, checked

    chain = load_chain(config["actuator"])
    sentence = "simulated.runs, simulated.seconds and simulated.rate must be positive."
    numbers = {
        key: checked(f"simulated.{key}", value, Positive, sentence) for key, value in config["simulated"].items()
    }
    print(f"Simulating {numbers['runs']:g} runs of {numbers['seconds']:g} s with the chain '{chain.label}'.")
    runs = simulated_runs(chain, int(numbers["runs"]), numbers["seconds"], numbers["rate"], config["seed"])
    behind = tuple(stage for stage in chain.stages if stage.name in BEHIND)
    return runs, behind, chain.label, chain.armature()


def _measured(config: dict[str, Any]) -> list[TrainingRun]:
    """Runs of one joint of a measured log."""
    from ..gap.load.robot import robot_of
    from ..gap.load.units import in_model_units
    from ..gap.log import read_measured

    if config["target"] not in ("auto", "torque", "motion"):
        raise SealegsError(f"target is {config['target']!r}; it is auto, torque or motion.")
    measured = read_measured(str(config["log"]))
    measured, _ = in_model_units(measured, robot_of(measured.runs[0]))
    joints = sorted({joint for item in measured.runs for joint in item.joints})
    joint = config["joint"]
    if joint is None and len(joints) > 1:
        raise SealegsError(f"the log has the joints {', '.join(joints)}; say which one to learn with joint=.")
    joint = joints[0] if joint is None else joint
    if joint not in joints:
        raise SealegsError(f"the log has no joint '{joint}'{nearest(str(joint), joints)}; it has {', '.join(joints)}.")
    recorded = [item for item in measured.runs if joint in item.joints]
    if len({repr(item.actuators.get(joint)) for item in recorded}) > 1:
        print("Note: the runs differ in their actuators (gains, firmware), which a net cannot see: it learns a mix.")
    runs = [_run_of(item, joint, config) for item in recorded]
    if len(armatures := sorted({run.armature for run in runs})) > 1:
        raise SealegsError(
            f"the actuators of the runs have armatures from {armatures[0]:g} to {armatures[-1]:g} kg.m2, but a net "
            "stands beside one; give armature=, or train on runs of one actuator."
        )
    return runs


def _run_of(item: MeasuredRun, joint: str, config: dict[str, Any]) -> TrainingRun:
    from ..actuators.chain import load_chain
    from ..actuators.net_training import TrainingRun

    log = item.joints[joint]
    if log.goal is None:
        raise SealegsError(
            f"{item.name} has no {joint}.goal column; a net learns from position error, which needs goals."
        )
    torque = log.torque if config["target"] != "motion" else None
    if torque is None and config["target"] == "torque":
        raise SealegsError(f"{item.name} has no {joint}.torque column; target=motion learns from the motion instead.")
    inertia, gravity = 0.0, 0.0
    if torque is None:
        if item.robot != "bench":
            raise SealegsError(
                f"{item.name} has no torque column and was not recorded on a bench, so the load is not known."
            )
        from ..envs.bench.robot import NUMBERS, pendulum

        load = {key: float(item.robot_params.get(key, number.value or 0.0)) for key, number in NUMBERS.items()}
        total, centre, about_centre = pendulum(load)
        inertia, gravity = about_centre + total * centre**2, GRAVITY * total * centre
    armature = config["armature"]
    if armature is None:
        armature = load_chain(item.actuators[joint]).armature() if joint in item.actuators else 0.0
    usable = None if log.enabled is None else log.enabled > 0.5
    return TrainingRun(
        item.name,
        time=item.time,
        goal=log.goal,
        position=log.position,
        velocity=log.velocity,
        torque=torque,
        inertia=inertia,
        gravity=gravity,
        armature=float(armature),
        usable=usable,
    )


def _train(runs: list[TrainingRun], settings: Settings) -> TrainedNet:
    from rich.progress import Progress

    from ..actuators.net_training import train

    with Progress(transient=True) as bar:
        task = bar.add_task("training", total=settings.epochs)

        def progress(epoch: int, error: float, unseen: float) -> None:
            bar.update(task, completed=epoch, description=f"rms {error:.4f}, unseen runs {unseen:.4f} N.m")

        return train(runs, settings, progress)
