"""Servos and their machine in this process and in simulated time, for a loop that need not wait for a clock.

Nothing here outlives the process: whatever ends it, a ``kill -9`` too, ends the servos with it.
"""

from __future__ import annotations

import errno
import heapq
import threading
from collections.abc import Mapping
from typing import Any

from ...common.alarm import to_stderr
from ...common.errors import SealegsError
from ...configs.check import checked, checked_seed
from ...envs.described.robot_imu import with_imu
from ...envs.extended import read_extended
from ...envs.robots import get_robot
from ..bus.port import WAIT, BusPort, Echo
from ..bus.registers import ServoModel, load_model, ready_at
from ..bus.servo_bus import ServoBus
from ..machine.robot import ServoRobot
from .machine import Machine
from .rig import Held, Rig, mounts
from .wire import Fault, Wire, first, read_faults

STEP = 0.005  # [s] between two looks at the faults while nobody asks


class SimulatedClock:
    """The time of one machine, for all ports to it.

    Time passes only while bytes are on the wire, while a reply is waited for, and while somebody sleeps. Time-outs,
    round trips and overruns are therefore those of this clock, equal in every run, whatever else the computer does.

    Attributes:
        time: [s].
        wires: lines to its servos.
        lock: for who lets it pass: an emergency stop is a thread of its own.
    """

    def __init__(self, time: float) -> None:
        self.time = time
        self.wires: list[Wire] = []
        self.lock = threading.RLock()


class SimulatedPort(BusPort):
    """The port of a :class:`~sealegs.hw.bus.servo_bus.ServoBus` (``opened=``), and the clock of its loop.

    Attributes:
        wire: servos and their line.
        clock: shared by all ports to one machine.
        latency: of the adapter, on every reply and echo [s].
    """

    simulated = True

    def __init__(
        self,
        wire: Wire,
        reply_timeout: float = 0.02,
        baudrate: int = 1_000_000,
        latency: float = 0.0,
        clock: SimulatedClock | None = None,
    ) -> None:
        self.port_name, self.baudrate = "simulated", baudrate
        self.reply_timeout, self.latency = reply_timeout, latency
        self.wire = wire
        self.is_open, self.is_using = True, False
        self.discarded = self.received = 0
        self.tx_time_per_byte = 10_000.0 / baudrate  # [ms]
        self.ser = None
        self.clock = clock or SimulatedClock(wire.rig.time)
        if wire not in self.clock.wires:
            self.clock.wires.append(wire)
        self._deadline = 0.0
        self._coming: list[tuple[float, int, bytes]] = []
        self._sequence = 0
        self._buffer = bytearray()
        self.echo, self._ready = Echo(), bytearray()

    # --- clock -------------------------------------------------------------------------------------------------

    def now(self) -> float:
        """Of the simulated clock [s]."""
        return self._time

    def sleep(self, seconds: float) -> None:
        """Let time pass; the machine moves on."""
        end = self._time + max(seconds, 0.0)
        while self._time < end:
            with self.clock.lock:
                self._time = min(self._time + STEP, end)
                for wire in self.clock.wires:
                    wire.apply_faults(self._time)
                self.wire.rig.advance(self._time)
                self.wire.rig.apply()

    # --- port --------------------------------------------------------------------------------------------------

    def closePort(self) -> None:
        """Close the device."""
        self.is_open = self.is_using = False

    def reopened(self) -> SimulatedPort:
        """Another port of the same wire, at the same time, as another program would open it."""
        return SimulatedPort(self.wire, self.reply_timeout, self.baudrate, self.latency, self.clock)

    @property
    def _time(self) -> float:
        return self.clock.time

    @_time.setter
    def _time(self, time: float) -> None:
        self.clock.time = time

    def waiting(self) -> bytes:
        """What has come in."""
        self._arrive()
        data = bytes(self._buffer)
        self._buffer.clear()
        return data

    def writePort(self, packet: list[int]) -> int:
        """Carry a request to the servos."""
        self._require_adapter()
        data = bytes(packet)
        if first(self.wire.faults, "echo", self._time) is not None:
            self._push(self._time + self.latency, data)
        with self.clock.lock:
            for request in self.wire.requests(bytearray(data)):
                for at, reply in self.wire.exchange(request, self._time, self.baudrate):
                    self._push(at + self.latency, reply)
        for servo in self.wire.servos:
            if servo.refused is not None:
                to_stderr(servo.refused)
                servo.refused = None
        return len(data)

    def take(self, length: int) -> bytes:
        """Up to ``length`` bytes; waits for the first as long as a real port does."""
        self._require_adapter()
        self._arrive()
        if not self._buffer:
            end = self._time + WAIT
            if self._time <= self._deadline < end:
                end = self._deadline + 1e-9
            self._time = max(self._time, min(end, self._coming[0][0])) if self._coming else end
            self._arrive()
        data = bytes(self._buffer[:length])
        del self._buffer[:length]
        return data

    def setPacketTimeoutMillis(self, msec: float) -> None:
        """Start a timeout of so many milliseconds."""
        self._deadline = self._time + 1e-3 * msec

    def isPacketTimeout(self) -> bool:
        """Whether the timeout is over."""
        return self._time > self._deadline

    def _push(self, at: float, data: bytes) -> None:
        heapq.heappush(self._coming, (at, self._sequence, data))
        self._sequence += 1

    def _arrive(self) -> None:
        while self._coming and self._coming[0][0] <= self._time:
            self._buffer += heapq.heappop(self._coming)[2]

    def _require_adapter(self) -> None:
        if first(self.wire.faults, "unplug", self._time) is not None:
            raise OSError(errno.EIO, "the adapter is gone")


RATE = 1_000_000  # [bit/s]
PLAIN = ("robot", "actuator", "extended", "hidden", "faults", "link")
"""Keys of ``configs/virtual.yaml`` that name files, or are words."""


def bus_in_process(
    robot: ServoRobot,
    truth: Any = None,
    *,
    hidden: str | None = None,
    pose: Mapping[str, float] | None = None,
    timeout: float = 0.02,
    latency: float = 0.0,
) -> tuple[ServoBus, Rig]:
    """An open bus with the robot's servos, mounted as the host believes, and the rig behind it.

    Args:
        robot: as the host sees it.
        truth: chains that the machine has before ``hidden``; None: those of ``robot``.
        hidden: file of what the machine really is.
        pose: in which a hand holds the robot until ``rig.held`` is None; None: until torque comes on.
        timeout: of the bus [s].
        latency: of the adapter, on every reply and echo [s].

    Raises:
        SealegsError: the machine cannot be built.
    """
    sensors = {sensor.name: abs(sensor.per_radian) for sensor in robot.sensors}
    chains = dict(robot.chains) if truth is None else truth
    machine = Machine(robot.robot, chains, hidden, robot.params, sensors, pose)
    placed: dict[str, dict[str, float]] = {
        j.name: {"id": j.id, "zero": j.zero, "direction": j.direction, "per_radian": j.per_radian} for j in robot.joints
    }
    placed |= {s.name: {"id": s.id, "zero": s.zero, "direction": 1 if s.per_radian > 0 else -1} for s in robot.sensors}
    mounted = mounts(machine.encoders, placed, robot.servo)
    registers = {"": {**ready_at(robot.servo, RATE), **robot.registers}}
    rig = Rig(machine, robot.servo, mounted, "order" if pose else "torque", registers=registers)
    port = SimulatedPort(Wire(rig, []), timeout, latency=latency)
    return ServoBus("simulated", model=robot.servo.name, timeout=timeout, opened=port), rig


def wires_of(config: Mapping[str, Any]) -> list[Wire]:
    """The lines to one machine, the first at first, from ``configs/virtual.yaml``.

    Raises:
        SealegsError: a value is wrong.
    """
    robot = get_robot(checked("robot", config["robot"], str))
    model = load_model(checked("model", config["model"], str))
    hidden = checked("hidden", config["hidden"], str | None)
    robot = with_imu(robot, config["imu"])
    seed = checked_seed(config["seed"])
    actuator, params = config["actuator"], config["params"]
    if (folder := checked("extended", config["extended"], str | None)) is not None:
        if actuator is not None:
            raise SealegsError("actuator= and extended= both say which chain drives the robot; give one of them.")
        found = read_extended(folder)
        actuator, params = dict(found.chains_on(robot)), found.params_on(robot, params)
    machine = Machine(robot, actuator, hidden, params, config["sensors"], config["pose"], seed)
    others = {str(name): load_model(checked(f"buses.{name}", row, str)) for name, row in config["buses"].items()}
    mounted = mounts(machine.encoders, config["servos"], model, others)
    counts = {"": _registers(config["registers"], model)}
    counts |= {name: _registers(config["bus_registers"].get(name), table) for name, table in others.items()}
    held = checked("held", config["held"], Held | None)
    rig = Rig(machine, model, mounted, held, others=others, registers=counts)
    return [Wire(rig, _faults(config), seed + k, name) for k, name in enumerate(["", *others])]


def ports_of(config: Mapping[str, Any], baudrates: Mapping[str, int], timeout: float) -> dict[str, SimulatedPort]:
    """Open ports to the lines of :func:`wires_of`, on one clock, by name of the line.

    Args:
        config: of ``configs/virtual.yaml``; there is nothing that could ``link`` to such a port from outside.
        baudrates: by name of the line [bit/s].
        timeout: for a reply [s].

    Raises:
        SealegsError: a value is wrong.
    """
    if config["link"] is not None:
        raise SealegsError("link names a port for other programs; in stepped time there is none: leave it out.")
    wires, latency = wires_of(config), duration("latency", config)
    clock = SimulatedClock(wires[0].rig.time)
    return {wire.bus: SimulatedPort(wire, timeout, baudrates[wire.bus], latency, clock) for wire in wires}


def duration(key: str, config: Mapping[str, Any]) -> float:
    """A time of the config [s].

    Raises:
        SealegsError: it is none.
    """
    if (value := checked(key, config[key], float)) < 0.0:
        raise SealegsError(f"{key} is {value:g} s; it cannot be negative.")
    return value


def _registers(given: Mapping[str, Any] | None, model: ServoModel) -> dict[str, int]:
    """Counts that servos keep, checked.

    Raises:
        SealegsError: there is no such register, or it does not take the count.
    """
    found = {}
    for name, value in (given or {}).items():
        count, register = checked(f"registers.{name}", value, int), model[str(name)]
        if register.area != "eeprom" or not register.low <= count <= register.high:
            raise SealegsError(
                f"registers.{name} is {count}; it must be a register that servos keep without power, and its count "
                f"between {register.low} and {register.high}."
            )
        found[str(name)] = count
    return found


def _faults(config: Mapping[str, Any]) -> list[Fault]:
    """The faults of a config; each line has its own, which it counts down."""
    return read_faults(config["faults"]) if config["faults"] is not None else []
