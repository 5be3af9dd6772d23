"""The firmware of one virtual Dynamixel of the X series, protocol 2: registers, protection, bus watchdog.

Source: ROBOTIS' e-Manual. Behaviour that it does not state is marked assumed.
"""

from __future__ import annotations

import math

from ..bus.packets import HARDWARE_ERRORS, Status
from ..bus.registers import Register, ServoModel
from . import protocol
from . import protocol2 as wire
from .firmware import OFF, ON, RESET_VOLTAGE, Firmware, share
from .machine import Drive

BOOT = 0.5  # [s] silent after a reboot; assumed
OVERLOADED, LOADED_FOR = 0.9, 2.0  # share of the duty limit, and for how long [s], that count as overload; assumed
VELOCITY, POSITION, EXTENDED = 1, 3, 4  # operating modes that are simulated; the first of wheels alone
STOPPED = -1
TORQUE_AT_BOOT = 1  # bit of startup_configuration
GOALS = ("goal_pwm", "goal_current", "goal_velocity", "goal_position")
"""Read-only while the bus watchdog has stopped the servo."""
BITS = {bit: number for number, bit in HARDWARE_ERRORS.items()}


class DynamixelServo(Firmware):
    """One Dynamixel."""

    def __init__(self, model: ServoModel, servo_id: int, joint: int, bus: str = "") -> None:
        super().__init__(model, servo_id, joint, bus)
        self._gain, self._damping = model["position_p_gain"].default, model["position_d_gain"].default
        self._by_address = sorted(model.registers.values(), key=lambda item: item.address)
        self._heard = 0.0
        self.boot(0.0, 0.0)

    # --- power -------------------------------------------------------------------------------------------------

    def allow_voltage(self, volts: float) -> None:
        """Set the stored voltage limits so that the machine's supply is within them."""
        low, high = self.model["min_voltage_limit"].default, self.model["max_voltage_limit"].default
        self._put(self._stored, "max_voltage_limit", max(high, math.ceil(11.5 * volts)))
        self._put(self._stored, "min_voltage_limit", min(low, math.floor(8.0 * volts)))

    def boot(self, now: float, silent: float = BOOT) -> None:
        """Start as after power-on: EEPROM into memory, faults forgotten, silent for a while.

        Torque is off, unless ``startup_configuration`` says otherwise.
        """
        self.memory = bytearray(self._stored)
        self.put("goal_pwm", self.get("pwm_limit"))
        self.put("goal_current", self.get("current_limit"))
        self.put("goal_velocity", self.get("velocity_limit"))
        self.silent_until = now + silent
        self.latched = False
        self._pending: bytes | None = None
        self._loaded_since: float | None = None
        self._history, self._velocity, self._profile_speed = [], 0.0, 0.0
        self._shutdown = False
        self._goal = self.target = float(self.sensors.steps)
        self._heard = now
        self.put("goal_position", self._shown())
        if "startup_configuration" in self.model.registers and self.get("startup_configuration") & TORQUE_AT_BOOT:
            self.put("torque_enable", ON)

    # --- requests ----------------------------------------------------------------------------------------------

    def hear(self, now: float) -> None:
        """A request went over the line, whoever it was for."""
        self._heard = now

    def execute(self, instruction: int, parameters: bytes, now: float) -> tuple[int, bytes] | None:
        """Carry out a request; error byte and data of its reply, or None where there is no reply."""
        level = self.get("status_return_level")
        if instruction == protocol.PING:
            number = self.model.model_number.to_bytes(2, "little")
            return self._alert(), number + bytes((self.get("firmware_version"),))
        if instruction == protocol.READ and len(parameters) == 4:
            start, length = (int.from_bytes(parameters[k : k + 2], "little") for k in (0, 2))
            return self.answer(start, length, now) if level >= 1 else None
        error = wire.INSTRUCTION
        if instruction == protocol.WRITE and len(parameters) >= 3:
            error = self.write(int.from_bytes(parameters[:2], "little"), parameters[2:], now)
        elif instruction == protocol.REG_WRITE and len(parameters) >= 3:
            self._pending, error = parameters, 0
            self.put("registered_instruction", 1)
        elif instruction == protocol.ACTION:
            error = wire.RESULT_FAIL if self._pending is None else 0
            if self._pending is not None:
                error = self.write(int.from_bytes(self._pending[:2], "little"), self._pending[2:], now)
            self._pending = None
            self.put("registered_instruction", 0)
        elif instruction == protocol.REBOOT:
            self.boot(now)
            error = 0
        return (error | self._alert(), b"") if level == 2 else None

    def answer(self, start: int, length: int, now: float) -> tuple[int, bytes]:
        """Error byte and data of the reply to a question for memory."""
        data = self.read(start, length, now)
        return self._alert(), data

    def read(self, start: int, length: int, now: float) -> bytes:
        """Bytes of the memory; what lies behind its end reads 0."""
        del now
        self._refresh()
        return bytes(self.memory[start : start + length]).ljust(length, b"\0")

    def write(self, start: int, data: bytes, now: float) -> int:
        """Write bytes, all or none; number of the error, 0 where there is none."""
        touched = [r for r in self._by_address if r.address < start + len(data) and start < r.address + r.bytes]
        if not touched:
            return wire.ACCESS
        for register in touched:
            inside = start <= register.address and register.address + register.bytes <= start + len(data)
            if not inside:
                return wire.LENGTH
            count = register.read(data, start)
            if (error := self._check(register, count)) != 0:
                return error
        before = self.get("torque_enable")
        for register in touched:
            at = register.address
            part = data[at - start : at - start + register.bytes]
            self.memory[at : at + register.bytes] = part
            if register.area == "eeprom":
                self._stored[at : at + register.bytes] = part
        names = {register.name for register in touched}
        if "torque_enable" in names:
            self._switch(before, now)
        if "goal_position" in names:
            self._goal = float(self.get("goal_position") - self.get("homing_offset"))
            if not self.get("profile_velocity"):
                self.target = self._goal
        if self.wheel and before == ON and not self.get("profile_acceleration"):
            self.speed = self._wanted_speed
        return 0

    def _check(self, register: Register, count: int) -> int:
        name = register.name
        if register.area == "read":
            return wire.ACCESS
        if register.area == "eeprom" and self.get("torque_enable") == ON:
            return wire.ACCESS
        if name in GOALS and self.get("bus_watchdog") == STOPPED:
            return wire.RANGE
        if not register.low <= count <= register.high:
            return wire.RANGE
        if name == "operating_mode" and count not in ((VELOCITY,) if self.wheel else (POSITION, EXTENDED)):
            known = (
                "1 (velocity), as its chain is told speeds" if self.wheel else "3 (position) and 4 (extended position)"
            )
            self.refused = (
                f"virtual Dynamixels know the operating modes {known}; servo {self.id} "
                f"was asked for {count} and stays in {self.get('operating_mode')}."
            )
            return wire.RANGE
        if name == "torque_enable" and count == ON and self._shutdown:
            return wire.RESULT_FAIL
        if name == "goal_position" and self.get("operating_mode") == POSITION:
            inside = self.get("min_position_limit") <= count <= self.get("max_position_limit")
            return 0 if inside else wire.LIMIT
        for goal, limit in (
            ("goal_pwm", "pwm_limit"),
            ("goal_current", "current_limit"),
            ("goal_velocity", "velocity_limit"),
        ):
            if name == goal and abs(count) > self.get(limit):
                return wire.LIMIT
        return 0

    def _switch(self, before: int, now: float) -> None:
        wanted = self.get("torque_enable")
        if wanted == ON and before == OFF:
            self._heard = now
            self._goal = self.target = float(self.sensors.steps)  # it holds where it is
            self.put("goal_position", self._shown())
            self._profile_speed = 0.0
        if wanted == OFF:
            self.speed = 0.0
        self._loaded_since = None

    # --- motion ------------------------------------------------------------------------------------------------

    @property
    def in_profile(self) -> bool:
        """Whether the set-point is on its way, so that it must be carried on in small steps."""
        if self.wheel:
            return self.get("torque_enable") == ON and self.speed != self._wanted_speed
        return self.get("torque_enable") == ON and self.target != self._goal

    @property
    def _wanted_speed(self) -> float:
        """Goal of the speed [step/s]; 0 once its bus watchdog has stopped it."""
        stopped = self.get("bus_watchdog") == STOPPED
        return 0.0 if stopped else self.get("goal_velocity") * self.model.si("goal_velocity") / self.model.step

    def move_target(self, span: float) -> None:
        """Carry the set-point on by ``span`` seconds."""
        step = self.model.step
        if self.wheel:
            most = self.get("profile_acceleration") * self.model.si("profile_acceleration") / step
            self.ramp(self._wanted_speed, most, span)
            return
        speed = self.get("profile_velocity") * self.model.si("profile_velocity") / step or math.inf
        ramp = self.get("profile_acceleration") * self.model.si("profile_acceleration") / step
        self.approach(speed, ramp, span)

    def goal_steps(self) -> float:
        """Step that the joint is steered to."""
        return self.target

    def drive(self, volts: float | None) -> Drive:
        """What the motor may do. The chain describes the servo as it left the factory; registers scale it.

        Args:
            volts: supply voltage in place of the chain's [V].
        """
        allowed = min(abs(self.get("goal_pwm")), self.get("pwm_limit")) * self.model["pwm_limit"].scale
        return Drive(
            connected=self.get("torque_enable") == ON,
            duty=min(allowed, 1.0),
            gain=share(self.get("position_p_gain"), self._gain),
            damping=share(self.get("position_d_gain"), self._damping),
            speed_gain=share(self.get("velocity_p_gain"), self.model["velocity_p_gain"].default),
            speed_integral=share(self.get("velocity_i_gain"), self.model["velocity_i_gain"].default),
            volts=volts,
        )

    # --- protection --------------------------------------------------------------------------------------------

    def tick(self, now: float, winding: float) -> None:
        """Look at velocity, temperature, protection and the bus watchdog.

        Args:
            now: [s].
            winding: resistance of the winding [ohm].
        """
        self.measure(winding)
        loaded = self.get("torque_enable") == ON and abs(self.sensors.duty) >= OVERLOADED
        self._loaded_since = (self._loaded_since or now) if loaded else None
        if self._loaded_since is not None and now - self._loaded_since >= LOADED_FOR:
            self.latched = True
        self.status(now)
        count = self.get("bus_watchdog")
        silence = count * self.model["bus_watchdog"].scale
        if count > 0 and self.get("torque_enable") == ON and now - self._heard > silence:
            self.put("bus_watchdog", STOPPED)
            self._goal = self.target = float(self.sensors.steps)  # it stops where it is, its torque on
        if self.sensors.voltage < RESET_VOLTAGE:
            self.boot(now)

    def status(self, now: float) -> int:
        """Its faults as bits of :class:`~sealegs.hw.bus.packets.Status`; each stays until a restart (assumed)."""
        del now
        bits = self.get("hardware_error_status")
        if self.outside(self.sensors.voltage):
            bits |= BITS[Status.VOLTAGE]
        if self.shown_temperature() >= self.get("temperature_limit"):
            bits |= BITS[Status.OVERHEAT]
        if self.latched:
            bits |= BITS[Status.OVERLOAD]
        self.put("hardware_error_status", bits)
        if bits & self.get("shutdown"):
            self._shutdown = True
            self.put("torque_enable", OFF)
        return sum(int(bit) for number, bit in HARDWARE_ERRORS.items() if bits & number)

    def _alert(self) -> int:
        return wire.ALERT if self.get("hardware_error_status") else 0

    def _shown(self) -> int:
        shown = self.sensors.steps + self.get("homing_offset")
        return shown % self.model.steps if self.get("operating_mode") == POSITION else shown

    def _refresh(self) -> None:
        sensors, model = self.sensors, self.model
        speed = self._velocity * model.step / model.si("present_velocity")
        self.put("present_position", self._shown())
        self.put("present_velocity", round(speed))
        self.put("present_pwm", round(sensors.duty / model["present_pwm"].scale))
        self.put("present_current", round(sensors.current / model["present_current"].scale))
        self.put("present_input_voltage", round(10.0 * sensors.voltage))
        self.put("present_temperature", self.shown_temperature())
        self.put("moving", int(self.moves or self.in_profile))
        self.put("position_trajectory", round(self.target + self.get("homing_offset")))
