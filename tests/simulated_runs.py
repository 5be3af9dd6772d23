"""Runs on virtual servos in this process and in simulated time: equal every time, whatever else the computer does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from sealegs.envs.engine.robot import Robot
from sealegs.envs.robots import get_robot
from sealegs.hw.bus.adapters import UsbAdapter, Whereabouts
from sealegs.hw.bus.buses import BusGroup
from sealegs.hw.bus.packets import PortError
from sealegs.hw.bus.registers import load_model, ready_at
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.guard.safety import Limits, Safety
from sealegs.hw.guard.stop import REASON as PRESSED
from sealegs.hw.guard.stop import Stop, release
from sealegs.hw.guard.supervisor import Line, Opening, Rest, Supervisor
from sealegs.hw.guard.take_over import Aftermath, bring_all_to_rest
from sealegs.hw.machine.robot import ServoRobot, build_robot, nominal_joints
from sealegs.hw.run.commands import Commands, Trajectory
from sealegs.hw.run.connection import bus_watchdog
from sealegs.hw.run.loop import ControlLoop, Outcome
from sealegs.hw.run.measured_log import MeasuredLog, make_sidecar
from sealegs.hw.run.policy import Policy, PolicyError
from sealegs.hw.virtual.in_process import SimulatedClock, SimulatedPort
from sealegs.hw.virtual.machine import Machine
from sealegs.hw.virtual.rig import Rig, mounts
from sealegs.hw.virtual.wire import Wire, fault_from

from benchmarks.bus import servo_row
from tests.servo_runs import config

XL330 = ("robot.servo=xl330_m288", "robot.actuator=xl330", "robot.params.mass=0.05", "robot.params.length=0.05")
"""A bench with a Dynamixel."""
LEGS = ("robot.servo=xl330_m288", "robot.actuator=sts3215")
"""A hopper with Dynamixels; its chain stays, for the protocol is what is tested."""
QUIET = {"range_margin": 9.0, "speed": 200.0, "following_error": 9.0, "current": 9.0}
"""Limits for a hopper that falls over: what is tested is the bus."""


class Guard:
    """A supervisor in the same process, which tries through a port of its own.

    Attributes:
        heard: words of the loop, in their order.
        patience: time that it goes on trying [s].
        rest: what becomes of the servos.
        lives: whether it listens.
        dies, pressed: when it dies, and when the emergency stop is pressed, as seen at the next word [s]; None: never.
        called_at: when the loop first said that it brings the servos to rest [s]; None: never.
        left: servos that the loop could not release, as it said; None: it did not.
        at_each: what else happens at each ``beat``, ``starting`` or ``resting`` that it hears.
    """

    def __init__(self, simulation: Simulation, rest: Rest = "release", patience: float = 1.0) -> None:
        self._simulation, self.patience = simulation, patience
        self.rest: Rest = rest
        self.heard: list[str] = []
        self.lives, self.pid = True, 4711
        self.dies: float | None = None
        self.pressed: float | None = None
        self.called_at: float | None = None
        self.left: list[str] | None = None
        self.at_each: dict[str, Callable[[], object]] = {}

    def _listens(self, word: str = "") -> bool:
        self.at_each.get(word, lambda: None)()
        now = self._simulation.port.now()
        if self.dies is not None and now >= self.dies:
            self.lives = False
        if self.pressed is not None and now >= self.pressed:
            self.pressed = None
            self._simulation.stop.press(PRESSED)
            release(as_supervisor(self), self._simulation.bus, self._simulation.robot.ids)
        return self.lives

    def beat(self) -> bool:
        return self._listens("beat")

    def asking(self) -> bool:
        return self._listens()

    def starting(self) -> bool:
        return self._listens("starting")

    def release_only(self) -> None:
        self.heard.append("release only")
        self.rest = "release"

    def resting(self) -> bool:
        self.heard.append("resting")
        self.called_at = self._simulation.port.now() if self.called_at is None else self.called_at
        return self._listens("resting")

    def holding(self) -> bool:
        self.heard.append("held")
        return self._listens()

    def leave_held(self) -> int:
        return self.pid

    def dismiss(self) -> None:
        self.heard.append("dismiss")

    def call(self, give_up: Callable[[], bool], left: Sequence[str]) -> bool:
        self.heard.append("call")
        self.left = list(left)

        def waited(seconds: float) -> None:
            if seconds > self.patience or give_up():
                raise TimeoutError

        simulation = self._simulation
        after = Aftermath(simulation.note, simulation.say, simulation.port, lambda: False, lambda: 0, self.pid)
        try:
            bring_all_to_rest(simulation.lines(), self.rest, after, "it was called", waited, left or None)
        except TimeoutError:
            return False
        self.heard.append("released" if self.rest == "release" else "brought to hold")
        return True


def as_supervisor(guard: Any) -> Supervisor:
    """A stand-in where a supervisor is asked for."""
    return guard


class TimedPolicy:
    """A policy whose calls take time of a simulated clock, and may fail.

    Attributes:
        seconds: that each call takes [s].
        blocks: number of the call that takes longer, and how long [s].
        sleep: lets time of the clock pass.
        asked: the clock in the state that each call got, in goals.
    """

    def __init__(self, policy: Policy, seconds: float = 0.0, blocks: tuple[int, float] = (0, 0.0)) -> None:
        self.path, self.contract, self.seconds, self.blocks = policy.path, policy.contract, seconds, blocks
        self.sleep: Callable[[float], None] = lambda _: None
        self._policy, self.fails_after = policy, 10**9
        self.asked: list[int] = []

    def act(self, observation: np.ndarray, command: np.ndarray, state: np.ndarray) -> Any:
        self.asked.append(round(state[0, 0]))
        self.sleep(self.seconds + self.blocks[1] * (len(self.asked) == self.blocks[0]))
        if len(self.asked) > self.fails_after:
            raise PolicyError("the policy stub.onnx broke off: a bug.")
        return self._policy.act(observation, command, state)


class Adapters:
    """The adapters of a simulation as its system lists them, and ports by the names that they have at the time.

    One that is unplugged is not listed; where its fault has a name, it comes back under that, in the same socket.
    """

    def __init__(self, ports: Mapping[str, SimulatedPort], serials: bool) -> None:
        self._ports, self._serials = ports, serials
        self._unplugged = {
            line: sorted((fault for fault in port.wire.faults if fault.kind == "unplug"), key=lambda fault: fault.at)
            for line, port in ports.items()
        }

    def device(self, line: str) -> str | None:
        """Path of a line's port; None: it is unplugged."""
        name, now = f"/dev/simulated{line}", self._ports[line].now()
        for fault in self._unplugged[line]:
            if fault.active(now):
                return None
            name = fault.name or name if fault.over(now) else name
        return name

    def listed(self) -> list[UsbAdapter]:
        """Those that are plugged in."""
        found = [(line, device) for line in self._ports if (device := self.device(line)) is not None]
        return [
            UsbAdapter(device, "1:2:", f"A{line}" if self._serials else None, f"1-1{line}") for line, device in found
        ]

    def opened(self, path: str) -> SimulatedPort:
        """A new port of the line whose adapter has this path now."""
        for line, port in self._ports.items():
            if self.device(line) == path:
                return port.reopened()
        raise PortError(f"there is no port {path}.")


class Simulation:
    """A robot, its servos, and a loop that is ready to run.

    Attributes:
        said: alarms, as (time on the simulated clock [s], line).
        wires, ports: by name of the bus; ``wire`` and ``port`` are the first.
        homes: where each adapter was.
        delays: by which its commands may keep a fault from being noticed [s].
    """

    def __init__(
        self,
        robot: str = "bench",
        *arguments: str,
        commands: Callable[[ServoRobot], Commands] | None = None,
        rate: float = 100.0,
        faults: Sequence[Mapping[str, Any]] = (),
        seed: int = 0,
        timeout: float = 0.02,
        latency: float = 0.0,
        folder: Path | None = None,
        limits: Mapping[str, Any] | None = None,
        hidden: str | None = None,
        pose: Mapping[str, float] | None = None,
        serials: bool = True,
        servos: int = 4,
        **keys: Any,
    ) -> None:
        row = robot == "row"
        settings = config(f"robot={'bench' if row else robot}", *arguments, patient=False)["robot"]
        model = servo_row(servos) if row else get_robot(robot)
        self.robot = row_of_servos(model) if row else build_robot(settings)
        sensors = {sensor.name: abs(sensor.per_radian) for sensor in self.robot.sensors}
        machine = Machine(model, settings["actuator"], hidden, settings["params"], sensors, pose)
        placed: dict[str, dict[str, Any]] = {
            j.name: {
                "id": j.id,
                "zero": j.zero,
                "direction": j.direction,
                "per_radian": j.per_radian,
                "bus": j.line.name,
            }
            for j in self.robot.joints
        }
        placed |= {s.name: {"id": s.id, "zero": s.zero, "bus": s.line.name} for s in self.robot.sensors}
        servo = self.robot.servo
        models = {line.name: line.model(servo) for line in self.robot.lines}
        others = {name: other for name, other in models.items() if name}
        registers: dict[str, Mapping[str, int]] = {name: ready_at(other, 1_000_000) for name, other in others.items()}
        registers[""] = {**ready_at(servo, 1_000_000), **self.robot.registers}
        mounted = mounts(machine.encoders, placed, servo, others)
        self.rig = Rig(machine, servo, mounted, "order" if pose else "torque", others=others, registers=registers)
        self.wires = {name: Wire(self.rig, [fault_from(row) for row in faults], seed, name) for name in models}
        clock = SimulatedClock(self.rig.time)
        self.ports = {
            name: SimulatedPort(wire, timeout, latency=latency, clock=clock) for name, wire in self.wires.items()
        }
        self.wire, self.port = self.wires[""], self.ports[""]
        self.adapters = Adapters(self.ports, serials)
        self.homes = {name: Whereabouts.of(f"/dev/simulated{name}", self.adapters.listed) for name in models}
        watchdog = bus_watchdog({"watchdog": 0.2}, 1.0 / rate)
        parts = {
            name: ServoBus("simulated", model=models[name].name, opened=port, timeout=timeout, watchdog=watchdog)
            for name, port in self.ports.items()
        }
        self.bus: Any = BusGroup(parts, parallel=False) if others else parts[""]
        self.said: list[tuple[float, str]] = []
        self.stop, self.delays = Stop(), 0.0
        self.guard = Guard(self, keys.get("rest", "release"))
        self.log = None
        if folder is not None:
            sidecar = make_sidecar(robot, settings["params"], self.robot.belief, {})
            self.log = MeasuredLog(
                folder, "run", sidecar, self.robot.names, self.robot.base_names, self.robot.measures_links
            )
        values = Limits.from_config({**settings["safety"], **(limits or {})})
        wanted = sine() if commands is None else commands
        self.loop = ControlLoop(
            self.bus,
            self.robot,
            Safety(self.robot, values, 1.0 / rate),
            wanted(self.robot),
            rate,
            log=self.log,
            begins=self._let_go,
            **{"supervisor": self.guard, "stop": self.stop, "alarm": self.say, **keys},
        )

    def say(self, line: str) -> None:
        """An alarm."""
        self.said.append((self.port.now(), line))

    def note(self, kind: str, **details: object) -> None:
        """An event of the supervisor's."""
        if self.log is not None:
            self.log.event(self.loop.elapsed, kind, **details)

    def lines(self) -> list[Line]:
        """The buses as a supervisor opens them."""
        found = []
        for line in self.robot.lines:
            ids = [joint.id for joint in self.robot.joints if joint.line.name == line.name]
            home, model = self.homes[line.name], line.model(self.robot.servo).name
            timeout, adapters = self.port.reply_timeout, self.adapters
            opening = Opening(home.path, 1_000_000, model, timeout, home, ids, adapters.listed, adapters.opened)
            found.append(Line(line.name, opening, ids))
        return [line for line in found if line.ids]

    def _let_go(self) -> None:
        self.rig.held = None

    def run(self, seconds: float = 2.0) -> Outcome:
        try:
            return self.loop.run(seconds)
        finally:
            if self.log is not None:
                self.log.close()

    def fault(self, kind: str, **values: Any) -> None:
        """Plant a fault on the first bus from now on."""
        self.wire.faults.append(fault_from({"kind": kind, **values}, self.port.now()))

    @property
    def torque(self) -> list[bool]:
        """Whether each joint's servo drives it."""
        return [self.rig.torque(k) for k in range(len(self.robot.joints))]

    @property
    def switched_on(self) -> bool:
        """Whether any servo's torque was ever on."""
        return any(on for _, _, on in self.rig.history)


def row_of_servos(model: Robot) -> ServoRobot:
    """Servos side by side, each with a small pendulum."""
    servo = load_model("sts3215")
    return ServoRobot(model, {}, servo, nominal_joints(model, servo, {}), dict(model.chains))


def sine(amplitude: float = 0.3, hertz: float = 0.5, offset: float = 0.0, seconds: float = 1000.0) -> Any:
    """A sine about the middle of each joint's range, all joints in step."""

    def made(robot: ServoRobot) -> Trajectory:
        time = np.arange(0.0, seconds, 0.01)
        middle = 0.5 * (robot.low + robot.high) + offset
        return Trajectory("sine", time, middle + amplitude * np.sin(2.0 * np.pi * hertz * time)[:, None])

    return made


def when_torque_came_on(simulation: Simulation) -> float:
    """Time of the machine [s]."""
    return next(time for time, _, on in simulation.rig.history if on)
