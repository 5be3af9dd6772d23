"""The firmware of one virtual servo: its registers, what it does on a request, how it protects itself.

Behaviour that no document states is marked assumed.
"""

from __future__ import annotations

import math

from ..bus.packets import Status
from ..bus.registers import ServoModel
from . import protocol
from .firmware import OFF, ON, RESET_VOLTAGE, Firmware, share
from .machine import Drive

BOOT = 0.8  # [s] silent after a reboot
VOLTAGE, OVERHEAT, OVERCURRENT, OVERLOAD = (
    int(bit) for bit in (Status.VOLTAGE, Status.OVERHEAT, Status.OVERCURRENT, Status.OVERLOAD)
)
RELEASING = VOLTAGE | int(Status.ENCODER) | OVERHEAT | OVERCURRENT  # an overload limits the torque, the others release
MODE_POSITION, MODE_VELOCITY = 0, 1
MODES = (MODE_POSITION, MODE_VELOCITY)  # that are simulated; PWM (2) and step (3) are not
DAMPING, HERE_IS_CENTRE = 2, 128
ABSENT = {"overload_torque": 80, "max_velocity": 0, "overcurrent_time": 200}
"""What servos of the SCS series do without a register for it; assumed. All else that they lack is 0."""


class Servo(Firmware):
    """One servo of the STS or the SCS series."""

    def __init__(self, model: ServoModel, servo_id: int, joint: int, bus: str = "") -> None:
        super().__init__(model, servo_id, joint, bus)
        settings = ("p_gain", "d_gain", "startup_force", "cw_dead_zone", "velocity_p_gain", "velocity_i_gain")
        self._factory = {name: model[name].default for name in settings if name in model.registers}
        self.boot(0.0, 0.0)

    def absent(self, name: str) -> int:
        """Count of a register that the SCS series does not have."""
        return self.get("max_torque") if name == "torque_limit" else ABSENT.get(name, 0)

    # --- power -------------------------------------------------------------------------------------------------

    def allow_voltage(self, volts: float) -> None:
        """Raise the stored voltage limit where the machine's supply needs it, as the maker of a 12 V servo did."""
        if 10.0 * volts > self.model["max_voltage"].default:
            self._put(self._stored, "max_voltage", math.ceil(11.5 * volts))

    def boot(self, now: float, silent: float = BOOT) -> None:
        """Start as after power-on: EEPROM into memory, torque off, silent for a while."""
        self.memory = bytearray(self._stored)
        self.put("torque_limit", self.get("max_torque"))
        self.put("lock", 1)
        self.silent_until = now + silent
        self._pending: bytes | None = None
        self._overload_since: float | None = None
        self._overcurrent_since: float | None = None
        self.latched = False  # overloaded, until torque is switched off
        self._released = False  # a fault released the output
        self._history: list[int] = []
        self._velocity = 0.0
        self.target = float(self._actual(self.get("goal_position")))
        self._goal = self.target
        self._move_speed, self._move_ramp, self._profile_speed = math.inf, 0.0, 0.0

    # --- requests ----------------------------------------------------------------------------------------------

    def execute(self, instruction: int, parameters: bytes, now: float) -> tuple[int, bytes] | None:
        """Carry out a request; error byte and data of its reply, or None where there is no reply."""
        quiet = self.get("response_level") == 0
        if instruction == protocol.PING:
            return self.status(now), b""
        if instruction == protocol.READ and len(parameters) == 2:
            return self.answer(parameters[0], parameters[1], now)
        if instruction == protocol.WRITE and len(parameters) >= 2:
            self.write(parameters[0], parameters[1:], now)
        elif instruction == protocol.REG_WRITE and len(parameters) >= 2:
            self._pending = parameters
            self.put("write_pending", 1)
        elif instruction == protocol.ACTION:
            if self._pending is not None:
                self.write(self._pending[0], self._pending[1:], now)
            self._pending = None
            self.put("write_pending", 0)
        elif instruction == protocol.REBOOT:
            self.boot(now)
            return None
        elif instruction == protocol.RESTORE:
            self._restore(now)
        elif instruction == protocol.CALIBRATE:
            self._calibrate(int.from_bytes(parameters[:2], "little") if len(parameters) >= 2 else self.model.centre)
        elif instruction not in (protocol.BACKUP, protocol.RESET):
            return None
        return None if quiet else (self.status(now), b"")

    def hear(self, now: float) -> None:
        """A request went over the line, whoever it was for."""

    def answer(self, start: int, length: int, now: float) -> tuple[int, bytes]:
        """Error byte and data of the reply to a question for memory."""
        data = self.read(start, length, now)
        return self.status(now), data

    def read(self, start: int, length: int, now: float) -> bytes:
        """Bytes of the memory; what lies behind its end reads 0."""
        self.status(now)  # the register says what the error byte of the reply says
        self._refresh()
        return bytes(self.memory[start : start + length]).ljust(length, b"\0")

    def write(self, start: int, data: bytes, now: float) -> None:
        """Write bytes; those of read-only registers are ignored."""
        lock_at = self.model["lock"].address
        lock = self.memory[lock_at]
        enabled = self.get("torque_enable")
        mode = self.model["operating_mode"].address if "operating_mode" in self.model.registers else -1
        for at, byte in enumerate(data, start):
            if at == mode and byte not in ((MODE_VELOCITY,) if self.wheel else MODES):
                known = (
                    "0 (position) and 1 (velocity)" if not self.wheel else "1 (velocity), as its chain is told speeds"
                )
                self.refused = (
                    f"virtual servos know the operating modes {known}; servo {self.id} was asked "
                    f"for {byte} and stays in {self.memory[at]}."
                )
            elif at in self._writable:
                self.memory[at] = byte
                if at < self._first_ram and not lock and not self.forgetful:
                    self._stored[at] = byte
        if self.locked:
            self.memory[lock_at] = 1
        touched = range(start, start + len(data))
        if self.model["torque_enable"].address in touched:
            self._switch(enabled, now)
        if self.model["goal_position"].address in touched:
            self._new_goal()
        if self.wheel and enabled == ON and not self.get("acceleration"):
            self.speed = self._wanted_speed
        if self.model["max_torque"].address in touched:
            self.put("torque_limit", self.get("max_torque"))  # assumed: at once, not only at power-on

    def _switch(self, before: int, now: float) -> None:
        wanted = self.get("torque_enable")
        if wanted == HERE_IS_CENTRE:
            self.put("torque_enable", before)
            self._calibrate(self.model.centre)
            return
        if wanted == OFF:
            self.speed = 0.0
            self._overload_since = self._overcurrent_since = None
            self.latched = self._released = False
        elif before == OFF:
            self._released = bool(self.status(now) & self.get("unloading_condition") & RELEASING)
            self.target = float(self.sensors.steps)
            if self._whole_turn and not self._multi_turn and self.get("operating_mode") != MODE_VELOCITY:
                self.target -= self._turns() * self.model.steps
            self._new_goal()

    def _calibrate(self, step: int) -> None:
        offset = (self.sensors.steps - step) % self.model.steps
        if offset > self.model.steps // 2:
            offset -= self.model.steps
        largest = self.model["homing_offset"].high
        self.put("homing_offset", min(max(offset, -largest), largest))
        register = self.model["homing_offset"]
        self._stored[register.address : register.address + 2] = self.memory[register.address : register.address + 2]

    def _restore(self, now: float) -> None:
        servo_id = self.id
        for register in self.model.registers.values():
            self._put(self._stored, register.name, register.default)
        self._stored[self.model["id"].address] = servo_id
        self.boot(now)

    # --- motion ------------------------------------------------------------------------------------------------

    @property
    def _multi_turn(self) -> bool:
        return bool(self.get("phase") & 16)

    @property
    def _whole_turn(self) -> bool:
        return self.model.steps == self.model.resolution

    def _actual(self, present: float) -> float:
        return present + self.get("homing_offset")

    def _new_goal(self) -> None:
        goal = self.get("goal_position")
        low, high = self.get("min_angle"), self.get("max_angle")
        if low or high:
            goal = min(max(goal, low), high)
        self._goal = float(self._actual(goal))
        unit = 1 if self.get("phase") & 4 else 50
        speed, ramp = abs(self.get("goal_velocity")) * unit, self.get("acceleration") * 100
        top = self.get("max_velocity") * 50
        unlimited = float(top if ramp else 0) or math.inf
        self._move_speed = float(speed or (unlimited if self.get("phase") & 8 else 0.0))
        self._move_ramp = float(ramp)
        if math.isinf(self._move_speed) and self.get("operating_mode") == MODE_POSITION:
            self.target = self._goal

    @property
    def _wanted_speed(self) -> float:
        """Goal of the speed [step/s]."""
        return float(self.get("goal_velocity") * (1 if self.get("phase") & 4 else 50))

    @property
    def in_profile(self) -> bool:
        """Whether the set-point is on its way, so that it must be carried on in small steps."""
        if self.get("torque_enable") != ON:
            return False
        mode = self.get("operating_mode")
        if self.wheel:
            return self.speed != self._wanted_speed
        return mode == MODE_VELOCITY or (mode == MODE_POSITION and self.target != self._goal)

    def move_target(self, span: float) -> None:
        """Carry the set-point on by ``span`` seconds."""
        if self.wheel:
            self.ramp(self._wanted_speed, 100.0 * self.get("acceleration"), span)
            return
        if self.get("operating_mode") == MODE_VELOCITY:
            unit = 1 if self.get("phase") & 4 else 50
            self.target += self.get("goal_velocity") * unit * span
            return
        self.approach(self._move_speed, self._move_ramp, span)

    def goal_steps(self) -> float:
        """Step that the joint is steered to, in the turn that it shows: the loop does not take the short way."""
        turns = 0
        if self._whole_turn and not self._multi_turn and self.get("operating_mode") != MODE_VELOCITY:
            turns = self._turns()
        return self.target + turns * self.model.steps

    def _turns(self) -> int:
        """Turns from the one that it shows to where it is; assumed, the homing offset shifts their seam."""
        return math.floor((self.sensors.steps - self.get("homing_offset")) / self.model.steps)

    def drive(self, volts: float | None) -> Drive:
        """What the motor may do. The chain describes the servo as it left the factory; registers scale it.

        Args:
            volts: supply voltage in place of the chain's [V].
        """
        mode = self.get("torque_enable")
        allowed = self.get("torque_limit") / 1000.0
        if self.latched and self.get("unloading_condition") & OVERLOAD:
            allowed = min(allowed, self.get("protective_torque") / 100.0)
        return Drive(
            connected=mode != OFF and not self._released,
            duty=0.0 if mode == DAMPING else min(allowed, 1.0),
            gain=share(self.get("p_gain"), self._factory["p_gain"]),
            damping=share(self.get("d_gain"), self._factory["d_gain"]),
            startup=share(self.get("startup_force"), self._factory["startup_force"]),
            speed_gain=share(self.get("velocity_p_gain"), self._factory["velocity_p_gain"]) if self.wheel else 1.0,
            speed_integral=share(self.get("velocity_i_gain"), self._factory["velocity_i_gain"]) if self.wheel else 1.0,
            dead_zone=0.5 * (self.get("cw_dead_zone") + self.get("ccw_dead_zone")) / self._factory["cw_dead_zone"],
            volts=volts,
        )

    # --- protection --------------------------------------------------------------------------------------------

    def tick(self, now: float, winding: float) -> None:
        """Look at velocity, temperature and protection, one :data:`TICK` after the last time.

        Args:
            now: [s].
            winding: resistance of the winding [ohm].
        """
        self.measure(winding)
        sensors = self.sensors
        loaded = abs(sensors.duty) >= self.get("overload_torque") / 100.0 - 1e-9
        self._overload_since = (self._overload_since or now) if loaded else None
        if self._overload_since is not None and now - self._overload_since >= self.get("protection_time") * 0.01:
            self.latched = True
        limit = self.get("protection_current") * self.model["present_current"].scale
        strong = limit > 0.0 and abs(sensors.current) >= limit
        self._overcurrent_since = (self._overcurrent_since or now) if strong else None
        status = self.status(now)
        if status & self.get("unloading_condition") & RELEASING:
            self._released = True
        if sensors.voltage < RESET_VOLTAGE:
            self.boot(now)

    def status(self, now: float) -> int:
        """Its status byte."""
        byte = 0
        if self.outside(self.sensors.voltage):
            byte |= VOLTAGE
        if self.shown_temperature() >= self.get("max_temperature"):
            byte |= OVERHEAT
        since = self._overcurrent_since
        if since is not None and now - since >= self.get("overcurrent_time") * 0.01:
            byte |= OVERCURRENT
        if self.latched:
            byte |= OVERLOAD
        self.memory[self._places["status"][0]] = byte
        return byte

    def _refresh(self) -> None:
        sensors, offset = self.sensors, self.get("homing_offset")
        shown = sensors.steps - offset
        if not self._whole_turn:  # a potentiometer has ends
            shown = min(max(shown, 0), self.model.steps - 1)
        elif not self._multi_turn:
            shown %= self.model.steps
        velocity = self._velocity / (1 if self.get("phase") & 4 else 50)
        self.put("present_position", shown)
        self.put("present_velocity", round(velocity))
        self.put("present_load", round(1000.0 * sensors.duty))
        self.put("present_voltage", round(10.0 * sensors.voltage))
        self.put("present_temperature", self.shown_temperature())
        self.put("moving", int(self.moves or self.in_profile))
        self.put("target_position", round(self.target - offset))
        current = abs(sensors.current) if self.unsigned else sensors.current
        self.put("present_current", round(current / self.model["present_current"].scale))
