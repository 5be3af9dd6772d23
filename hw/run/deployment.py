"""One run on servos from its config: robot, policy or trajectory, bus, supervisor, loop and log put together."""

from __future__ import annotations

import contextlib
import datetime
import os
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from annotated_types import Ge, Le

from ...common.alarm import to_stderr
from ...common.atomic import fresh
from ...common.errors import SealegsError
from ...configs.check import checked, checked_seed
from ...envs.bench.robot import BENCH
from ...envs.robots import get_robot
from ..bus.adapters import advice
from ..bus.clock import HIGHEST_RATE, LOWEST_RATE
from ..bus.imu import ImuSource
from ..bus.interface import Bus
from ..guard.safety import Limits, Safety
from ..guard.stop import PATIENCE, check_descriptor, emergency_stop, keyboard, pressed_key, release
from ..guard.stop import REASON as EMERGENCY
from ..guard.supervisor import Rest, Supervisor
from ..machine.calibration import as_row
from ..machine.calibration_file import newest
from ..machine.robot import ServoRobot, build_robot, extended_robot, unlike_the_factory, unlike_the_file
from .asked import KEYS, asked_for
from .commands import Commands, PolicyCommands, Reference, park_motion, read_excitation, read_replay
from .connection import Opened, charge_of, checked_hw, opened_bus, opened_imu, opened_port
from .live import live_view
from .loop import ControlLoop, Outcome, Stop
from .measured_log import MeasuredLog, make_sidecar, read_events
from .pace import measured, not_kept, realtime
from .policy import Policy
from .task_reference import TaskReference, library_excitation

RATE = 100.0  # [Hz] of what does not say its own
DURATION = 10.0  # [s] of what has no end of its own
DRY_CYCLES = 10
RESTS = ("release", "hold", "sit")
SOURCES = ("policy", "excitation", "replay", "reference")
KINDS: dict[str, Any] = {
    "silence": Annotated[float, Le(60.0)],
    "patience": Annotated[float, Ge(0.0), Le(3600.0)],
    **dict.fromkeys(("dead_man", "dry_run", "live"), bool),
    **dict.fromkeys(("rate", "duration"), float | None),
    "reach": float | dict[str, float] | None,
    "realtime": int | None,
}
"""Types of keys, where they need no more than that."""


@dataclass(frozen=True)
class Deployment:
    """A run that is ready to start.

    Attributes:
        config: as composed from ``configs/deploy.yaml``.
        robot: with its calibration.
        commands: source of goals.
        limits: safety limits.
        rate: [Hz].
        duration: [s].
        calibration: file; None: built as drawn.
        park: motion along which the robot sits down at the end; None: it does not.
    """

    config: dict[str, Any]
    robot: ServoRobot
    commands: Commands
    limits: Limits
    rate: float
    duration: float
    calibration: Path | None
    park: Commands | None = None


class NotAtRestError(SealegsError):
    """A run has ended, and servos may still have torque."""


@dataclass(frozen=True)
class Run:
    """A run that is over.

    Attributes:
        outcome: of the loop.
        log: its file.
    """

    outcome: Outcome
    log: Path


def prepare(config: Mapping[str, Any], source: Callable[[ServoRobot], Commands] | None = None) -> Deployment:
    """Check a config and everything that it names; nothing is opened, nothing moves.

    Args:
        config: as composed from ``configs/deploy.yaml``.
        source: makes the goals; None: one of the config's :data:`SOURCES` does.

    Raises:
        SealegsError: something in it is wrong, or policy and robot do not fit.
    """
    config = dict(config)
    for key, kind in KINDS.items():
        config[key] = checked(key, config[key], kind)
    config["hw"] = checked_hw(config["hw"])
    config["rest"] = config["rest"] or config["robot"].get("rest") or "release"
    if config["rest"] not in RESTS:
        raise SealegsError(f"rest is '{config['rest']}'; it may be release, hold or sit.")
    estop = config["estop"]
    if estop not in (None, "key") and (isinstance(estop, bool) or not isinstance(estop, int)):
        raise SealegsError(f"estop is {estop!r}; it may be key, or the number of a file descriptor.")
    if isinstance(estop, int):
        check_descriptor(estop)
    keys = {
        "estop=key": estop == "key",
        "dead_man=true": config["dead_man"],
        "command=keyboard": config["command"] == KEYS,
    }
    if len(both := [word for word, wanted in keys.items() if wanted]) > 1:
        raise SealegsError(f"{' and '.join(both)} both need the keyboard: give one of them.")
    if config["overruns"] not in ("log", "stop"):
        raise SealegsError(f"overruns is '{config['overruns']}'; it may be log or stop.")
    given = [key for key in SOURCES if config[key] not in (None, False)]
    if len(given) != 1 and source is None:
        what = f"{' and '.join(given)} cannot run at once" if given else "say what to run"
        raise SealegsError(f"{what}: give one of {', '.join(f'{key}=' for key in SOURCES)} (--help lists the keys).")
    asked = given == ["policy"] or (given == ["reference"] and config["reference"] is not True)
    if config["command"] is not None and not asked:
        raise SealegsError(
            f"command= is what a policy or a task's reference is asked for; leave it out with {''.join(given[:1])}=."
        )
    calibration = calibration_of(config)
    if config["extended"] is None:
        robot = build_robot(config["robot"], config["actuator"], calibration, config["port"])
    elif config["actuator"] is None:
        robot = extended_robot(config["robot"], str(config["extended"]), calibration, config["port"])
    else:
        raise SealegsError("actuator= and extended= both say which chain drives the robot; give one of them.")
    commands = _commands(given[0], config, robot) if source is None else source(robot)
    rate = next(rate for rate in (config["rate"], commands.rate, RATE) if rate is not None)
    if not LOWEST_RATE <= rate <= HIGHEST_RATE:
        raise SealegsError(f"rate is {rate:g} Hz; it must be between {LOWEST_RATE:g} and {HIGHEST_RATE:g} Hz.")
    own = commands.duration if np.isfinite(commands.duration) else DURATION
    duration = own if config["duration"] is None else config["duration"]
    if duration <= 0.0 or config["silence"] < 3.0 / rate:
        raise SealegsError(
            f"duration is {duration:g} s and silence {config['silence']:g} s; the first must be above 0, the other at "
            f"least three periods ({3.0 / rate:g} s)."
        )
    limits = Limits.from_config(config["robot"].get("safety") or {})
    Safety(robot, limits, 1.0 / rate)  # limits that do not fit the joints are refused here
    park = park_motion(config["robot"].get("park"), robot) if config["rest"] == "sit" else None
    return Deployment(
        config,
        robot=robot,
        commands=commands,
        limits=limits,
        rate=rate,
        duration=duration,
        calibration=calibration,
        park=park,
    )


def run(deployment: Deployment, say: Callable[[str], None] = print) -> Run | None:
    """Run, and bring the servos to rest whatever happens.

    Returns:
        The run; None for a dry one.

    Raises:
        SealegsError: the servos cannot be reached, or the log cannot be written.
    """
    config, robot = deployment.config, deployment.robot
    stop = Stop()
    truth, params = config["robot"].get("actuator"), config["robot"].get("params") or {}
    pose = getattr(deployment.commands, "pose", None)
    opened = opened_port(config["hw"], config["port"], robot, truth, params, pose)
    with stop.on_signals(), opened as found:
        bus = opened_bus(config["hw"], found.within or found.ports, robot, 1.0 / deployment.rate)
        with contextlib.closing(bus), opened_imu(found) as imu:
            if config["dry_run"]:
                dry_run(deployment, bus, say, imu)
                return None
            return _guarded(deployment, bus, found, stop, say, imu)


def dry_run(deployment: Deployment, bus: Bus, say: Callable[[str], None], imu: ImuSource | None = None) -> None:
    """Print the goals of the first cycles, computed from what the servos report, torque off throughout."""
    robot, period = deployment.robot, 1.0 / deployment.rate
    for error in bus.torque_off(robot.ids).values():
        raise error
    safety = Safety(robot, deployment.limits, period)
    pace = measured(bus, robot, deployment.commands, period, imu)
    if not bus.clock.simulated:  # on which a policy takes no time
        say(pace.too_slow(period) or pace.sentence())
    say(f"Dry run at {deployment.rate:g} Hz, no torque. Goals:")
    named = [f"{name} [{unit}]" for name, unit in zip(robot.names, robot.units, strict=True)]
    say("  time [s]  " + "  ".join(f"{name:>18}" for name in named))
    last: np.ndarray | None = None
    for cycle in range(DRY_CYCLES):
        reading = robot.reading(bus.read_state(robot.all_ids), sample=None if imu is None else imu.latest())
        if (fault := safety.judge(reading)) is not None:
            say(f"  safety would stop here: {fault.sentence}")
            return
        start = deployment.commands.start()
        last = (robot.staying(reading.position) if start is None else start) if last is None else last
        wanted = deployment.commands.goals(cycle * period, reading)
        admitted = safety.admit(wanted, np.clip(last, robot.low, robot.high))
        if not isinstance(admitted, np.ndarray):
            say(f"  safety would stop here: {admitted.sentence}")
            return
        cells = [f"{a:+.3f}" + (f" (of {w:+.3f})" if a != w else "") for a, w in zip(admitted, wanted, strict=True)]
        say(f"  {cycle * period:8.3f}  " + "  ".join(f"{cell:>18}" for cell in cells))
        last = admitted


def _guarded(
    deployment: Deployment,
    bus: Bus,
    opened: Opened,
    stop: Stop,
    say: Callable[[str], None],
    imu: ImuSource | None,
) -> Run:
    config, robot = deployment.config, deployment.robot
    hw = config["hw"]
    with contextlib.ExitStack() as stack:
        stack.callback(to_stderr.flush)  # lines of the run stand above its report
        switch = stack.enter_context(keyboard(config["dead_man"]))
        rest: Rest = "hold" if config["rest"] == "hold" else "release"
        registers = {joint.name: bus.identity(joint.address) for joint in robot.joints}
        for joint in robot.joints:
            for line in unlike_the_factory({joint.name: registers[joint.name]}, joint.line.model(robot.servo)):
                say(line)
        for line in unlike_the_file(registers, robot, opened.ports):
            say(line)
        log = stack.enter_context(contextlib.closing(_log(deployment, bus.port, registers)))
        for name, path in opened.ports.items():
            if (line := advice(path, f"robot.buses.{name}.port" if name else "port")) is not None:
                say(line)
        bench = robot.robot.source == BENCH.name  # a file may have that name too, and no such numbers
        if bench and hw["virtual"] is None and not {"mass", "length"} <= robot.params.keys():
            say(
                "A diagnosis needs to know what hangs on the servo: give robot.params.mass [kg] and "
                "robot.params.length [m], or write them under robot_params in the log's sidecar."
            )
        if config["dead_man"]:
            say(f"Hold the space bar down: torque comes on then, and the run ends {PATIENCE:g} s after it is let go.")
        if (asked := getattr(deployment.commands, "asked", None)) is not None:
            stack.enter_context(asked.opened())
        by_key = config["estop"] == "key"
        button = stack.enter_context(pressed_key()) if by_key else config["estop"]
        say(
            f"Running {deployment.commands.name} at {deployment.rate:g} Hz for {deployment.duration:g} s, "
            f"into {log.path}"
        )
        if isinstance(deployment.commands, TaskReference) and (decide := deployment.commands.deciding()):
            told = ", ".join(f"{name}: {value}" for name, value in decide.items())
            say(f"The reference follows from the robot; to change it, give some of these in reference=: {told}")
        supervisor = None
        if not opened.within:  # such servos end with this process: nobody would be left to guard
            charge = charge_of(config, opened.ports, robot, rest, str(log.events_path.resolve()), deployment.limits)
            # a terminal's keys are the shell's again when the run is over
            supervisor = Supervisor(replace(charge, button=None if by_key else button))
        pressed = stack.enter_context(emergency_stop(button, stop, lambda: release(supervisor, bus, robot.ids)))
        loop = ControlLoop(
            bus,
            robot,
            Safety(robot, deployment.limits, 1.0 / deployment.rate),
            deployment.commands,
            deployment.rate,
            log=log,
            supervisor=supervisor,
            rest=rest,
            park=deployment.park,
            stop=stop,
            each_cycle=switch or (lambda: None),
            armed=(lambda: switch.armed(lambda: stop.reason is not None)) if switch else (lambda: None),
            overruns=config["overruns"],
            begins=opened.let_go,
            imu=imu,
        )
        stack.enter_context(realtime(config["realtime"], [*bus.threads, *pressed]))
        with live_view(loop, config["live"]):
            try:
                outcome = loop.run(deployment.duration)
            except Exception:
                if loop.outcome is not None:
                    say(at_rest_sentence(Run(loop.outcome, log.path), config["rest"]))
                raise
        if loop.holder is not None and stop.emergency:
            say(f"{EMERGENCY}: process {loop.holder}, which watches the servos, releases them.")
        elif loop.holder is not None:
            also = "; the key no longer does" if by_key else "" if button is None else ", as does the emergency stop"
            say(f"The servos are held, and watched by process {loop.holder}: `kill {loop.holder}` releases them{also}.")
    return Run(outcome, log.path)


def report(deployment: Deployment, done: Run, say: Callable[[str], None] = print) -> None:
    """Tell what became of a run.

    Raises:
        NotAtRestError: torque may be on.
        SealegsError: it ended with a fault; the sentence says which.
    """
    outcome = done.outcome
    say(outcome.timing.sentence())
    if cut := outcome.told_cut():
        say(cut)
    if outcome.bus:
        kinds = ", ".join(f"{name} {count}" for name, count in outcome.bus.items())
        say(f"Replies that did not come or could not be used, within what safety allows: {kinds}.")
    if outcome.note:
        say(outcome.note)
    events = done.log.with_suffix(".events.jsonl")
    kept = f"; what happened until then is in {events}" if events.exists() else ""
    say(f"Log: {done.log if done.log.exists() else f'none, since the run ended before its first cycle{kept}'}")
    where = f"; the log is {done.log}" if done.log.exists() else kept
    late = not_kept(outcome.timing, deployment.rate, deployment.commands)
    ended = at_rest_sentence(done, deployment.config["rest"])
    if _not_at_rest(done):
        cause = f" ({outcome.fault.sentence.rstrip('.')})" if outcome.fault else ""
        raise NotAtRestError(f"{ended.rstrip('.')}{cause}{where}.")
    if outcome.fault is not None:
        why = f"safety stopped the run: {outcome.fault.sentence.rstrip('.')}; {ended.rstrip('.')}{where}."
        raise SealegsError(f"{why}{'' if outcome.fault.name == 'imu' else _on_a_stand(deployment)}")
    if late is not None:
        if deployment.commands.rate is not None and outcome.ending == "finished":  # which was made for its rate
            raise SealegsError(f"{late.rstrip('.')}; {ended.rstrip('.')}{where}.")
        say(late)


def _on_a_stand(deployment: Deployment) -> str:
    """What helps a simulated robot that falls where nothing balances its free base."""
    file = deployment.robot.robot.file
    if file is None or file.base != "free" or deployment.config["hw"]["virtual"] is None:
        return ""
    if isinstance(deployment.commands, PolicyCommands | TaskReference):  # whose task may be to balance it
        return ""
    return " Nothing balances the virtual machine's free base: `base: fixed` in its YAML puts it on a stand."


def at_rest_sentence(done: Run, rest: str) -> str:
    """What became of the servos."""
    if lost := _not_at_rest(done):
        return f"TORQUE MAY BE ON at servo(s) {', '.join(map(str, lost))}, which cannot be reached: cut their power."
    held = rest == "hold" and done.outcome.rest == "hold"
    return f"the servos are {'held' if held else 'released'}."


def _not_at_rest(done: Run) -> list[int]:
    """Servos that neither loop nor supervisor brought to rest."""
    if not done.outcome.not_at_rest:
        return []
    try:
        events = read_events(done.log)
    except OSError:  # the log's disk is gone: nothing is known but what the loop knows
        events = []
    for event in reversed(events):
        if event.get("by") == "loop":  # what is before it may be an earlier run's
            break
        if event.get("by") == "supervisor" and event["event"] in ("at rest", "not at rest"):
            return event.get("servos", [])
    return sorted(done.outcome.not_at_rest)


def calibration_of(config: Mapping[str, Any]) -> Path | None:
    """The calibration file that a config names, or the newest of its robot; None on a virtual machine.

    Raises:
        SealegsError: there is none for real servos.
    """
    if config["calibration"] is not None:
        return Path(str(config["calibration"]))
    if config["hw"]["virtual"] is not None:
        return None
    name = config["robot"]["name"]
    if (found := newest(get_robot(name).name)) is None:
        raise SealegsError(
            f"robot '{name}' has no calibration yet: make one with sealegs calibrate {shlex.quote(f'robot={name}')} "
            f"port={config['port'] or '<path>'}, or give calibration=<file>."
        )
    return found


def _commands(kind: str, config: Mapping[str, Any], robot: ServoRobot) -> Commands:
    if kind == "policy":
        policy = Policy(str(config["policy"]), config["task"])
        robot.check_contract(policy.contract, config["rate"])
        return policy_commands(policy, robot, config["command"])
    if kind == "replay":
        return read_replay(Path(str(config["replay"])), robot)
    if kind == "reference" and config["reference"] is not True:
        return TaskReference(config["reference"], robot, config["command"])
    if kind == "reference":
        return Reference(robot)
    word = str(config["excitation"])
    if Path(word).suffix == ".csv":
        return read_excitation(Path(word), robot)
    return library_excitation(word, robot, config["reach"], checked_seed(config["seed"]))


def policy_commands(policy: Policy, robot: ServoRobot, word: Any) -> PolicyCommands:
    """Goals of a policy that is asked for what the key ``command`` says: numbers, a file, ``keyboard``, ``gamepad``, or
    a function of the caller's.

    Raises:
        SealegsError: the word is none of these, or does not fit the policy's task.
    """
    if word is None:
        return PolicyCommands(policy, robot)
    task = policy.contract.task_on(robot.robot)[0]
    if isinstance(word, list | int | float) and policy.contract.commands != len(task.asked_names()):
        values = np.atleast_1d(np.asarray(checked("command", word, list[float] | float), float))
        if len(values) == policy.contract.commands:  # such as a reach and phases of waves
            return PolicyCommands(policy, robot, values)
    return PolicyCommands(policy, robot, asked=asked_for(word, task))


def _log(deployment: Deployment, port: str, registers: Mapping[str, Mapping[str, int]]) -> MeasuredLog:
    config, robot, commands = deployment.config, deployment.robot, deployment.commands
    now = datetime.datetime.now().astimezone()
    real = config["hw"]["virtual"] is None
    # what was simulated never lies among what was measured: one diagnosis reads a whole folder
    folder = Path(str(config["out"] or Path("logs") / (robot.robot.name if real else f"{robot.robot.name}-virtual")))
    name = config["name"] or fresh(folder, commands.name).name
    meta = {
        "machine": "servos" if real else "virtual bus",
        "date": now.isoformat(timespec="seconds"),
        "command": commands.description,
        "rate": deployment.rate,
        "port": port,
        "servo": robot.servo.name,
        **({"buses": buses} if (buses := {i.name: i.model(robot.servo).name for i in robot.lines if i.name}) else {}),
        "calibration": {
            "file": None if deployment.calibration is None else str(deployment.calibration),
            **{joint.name: as_row(joint) for joint in robot.joints},
        },
        "safety": dict(config["robot"]["safety"]),
        **({"imu": dict(robot.imu.said)} if robot.imu is not None else {}),
        "registers": registers,
    }
    # the load of a virtual bench is known; of a real one, only what somebody says
    simulated = not real and robot.robot.source == BENCH.name
    params = robot.robot.parameters(robot.params) if simulated else robot.params
    word = robot.robot.name if robot.robot.file is None else os.path.relpath(robot.robot.file.path, folder.absolute())
    sidecar = make_sidecar(word, params, robot.belief, meta)
    told = {name: "goal_velocity" for name, turns in zip(robot.names, robot.turning, strict=True) if turns}
    return MeasuredLog(folder, str(name), sidecar, robot.names, robot.log_base, robot.measures_links, told)
