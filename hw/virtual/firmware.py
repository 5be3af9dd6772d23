"""What every virtual servo has, whoever makes it: memory, sensors, and a motor that gets warm."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..bus.packets import RegisterError
from ..bus.registers import BYTE_ORDER, ServoModel

TICK = 0.005  # [s] between two looks at protection, velocity and temperature; assumed
VELOCITY_TICKS = 4  # velocity is the encoder's difference over so many; assumed
RESET_VOLTAGE = 3.3  # [V] below which the controller stops; assumed
OFF, ON = 0, 1
AMBIENT = 25.0  # [degC]; assumed
HEAT_CAPACITY, HEAT_RESISTANCE = 40.0, 8.0  # [J/K], [K/W] of motor and case to the air; assumed
MOVING = 0.077  # [rad/s] above which the servo counts as moving; assumed


@dataclass
class Sensors:
    """What a servo's electronics measure: position in steps from the encoder's zero (turns included), and the rest."""

    steps: int = 0
    duty: float = 0.0
    current: float = 0.0
    voltage: float = 0.0


class Firmware:
    """Memory and measurements of one servo.

    Attributes:
        model: whose memory table it has.
        joint: number of the joint that it drives.
        bus: name of the line that it is on.
        memory: its registers.
        sensors: latest readings; whoever owns the servo keeps them up to date.
        temperature: of the case [degC].
        forced_temperature: that a fault pretends; None: the true one.
        silent_until: time at which it has booted [s].
        target: step that its loop steers to, homing offset included.
        frozen: step at which its position sensor is stuck; None: it is not.
        unsigned: whether it reports its current without its sign.
        locked: whether its lock register stays at 1.
        forgetful: whether it keeps nothing that is written from now on, once its power is off.
        latched: whether it is overloaded, until torque is switched off or it restarts.
        refused: the latest request that it could not follow because that is not simulated, in a sentence.
        wheel: whether it turns a wheel, by a chain that is told speeds.
        speed: of its wheel at the moment, as its ramp has it [step/s].
    """

    def __init__(self, model: ServoModel, servo_id: int, joint: int, bus: str = "") -> None:
        self.model, self.joint, self.bus = model, joint, bus
        self._places: dict[str, tuple[int, int, int | None, BYTE_ORDER]] = {
            item.name: (item.address, item.bytes, item.sign if not item.complement else -1, item.order)
            for item in model.registers.values()
        }
        self._id = model["id"].address
        self._stored = bytearray(model.size())  # EEPROM
        for register in model.registers.values():
            self._put(self._stored, register.name, register.default)
        self._stored[self._id] = servo_id
        self._first_ram = model["torque_enable"].address
        self._writable = {
            at
            for register in model.registers.values()
            if register.area != "read"
            for at in range(register.address, register.address + register.bytes)
        }
        self.memory = bytearray(self._stored)
        self.sensors = Sensors()
        self.temperature = AMBIENT
        self.forced_temperature: float | None = None
        self.silent_until = 0.0
        self.frozen: int | None = None
        self.unsigned = self.latched = self.locked = self.forgetful = False
        self.refused: str | None = None
        self.wheel, self.speed = False, 0.0
        self.target = self._goal = self._profile_speed = 0.0
        self._history: list[int] = []
        self._velocity = 0.0  # [step/s]

    # --- registers ---------------------------------------------------------------------------------------------

    @property
    def id(self) -> int:
        """Its id at the moment."""
        return self.memory[self._id]

    def get(self, name: str) -> int:
        """Count in a register; of one that the table lacks, what :meth:`absent` says."""
        place = self._places.get(name)
        if place is None:
            return self.absent(name)
        at, size, sign, order = place
        if size == 1:
            word = self.memory[at]
        elif size == 2 and order == "little":
            word = self.memory[at] | self.memory[at + 1] << 8
        else:
            word = int.from_bytes(self.memory[at : at + size], order)
        return word if sign is None else self.model.registers[name].decode(word)

    def absent(self, name: str) -> int:
        """Count of a register that this model does not have."""
        raise KeyError(name)

    def put(self, name: str, count: int) -> None:
        """Set a register, as the firmware itself does; one that the table lacks is nowhere."""
        if name in self._places:
            self._put(self.memory, name, count)

    def _put(self, memory: bytearray, name: str, count: int) -> None:
        register = self.model[name]
        data = register.word(count).to_bytes(register.bytes, register.order)
        memory[register.address : register.address + register.bytes] = data

    def set_up(self, name: str, count: int) -> None:
        """Set a register for good, as somebody did before."""
        self._put(self._stored, name, count)
        self._put(self.memory, name, count)

    def turn_wheel(self) -> None:
        """Work in the mode for speeds, as somebody set it up.

        Raises:
            RegisterError: this model has none.
        """
        if (mode := self.model.speed_mode) is None:
            raise RegisterError(f"a {self.model.name} has no mode for speeds, and cannot turn a wheel.")
        self.wheel = True
        self.set_up(mode.register, mode.value)

    def ramp(self, wanted: float, most: float, span: float) -> None:
        """Bring the wheel nearer to a speed [step/s], by ``most`` [step/s2] at most (0: any), within ``span`` [s]."""
        step = most * span if most else math.inf
        self.speed += min(max(wanted - self.speed, -step), step)

    def approach(self, speed: float, ramp: float, span: float) -> None:
        """Bring the set-point nearer to its goal within ``span`` [s], at ``speed`` [step/s] at most, and so that it can
        come to rest there by ``ramp`` [step/s2] (0: any)."""
        left = self._goal - self.target
        if ramp:
            self._profile_speed = min(self._profile_speed + ramp * span, speed)
            speed = min(self._profile_speed, math.sqrt(2.0 * ramp * abs(left)))
        change = speed * span
        if abs(left) <= max(change, 1e-3):
            self.target, self._profile_speed = self._goal, 0.0
        else:
            self.target += math.copysign(change, left)

    def _role(self, role: str) -> str:
        name = self.model.role(role)
        assert name is not None
        return name

    @property
    def baudrate(self) -> int:
        """That it listens at [bit/s]; 0 for a count that has none."""
        index = self.get(self._role("baud_rate"))
        return self.model.baud_rates[index] if index < len(self.model.baud_rates) else 0

    @property
    def reply_delay(self) -> float:
        """Before each of its replies [s]."""
        return self.get(self._role("return_delay")) * 2e-6

    # --- measurements ------------------------------------------------------------------------------------------

    def freeze(self, stuck: bool) -> None:
        """Let the position sensor stay where it is, or go on."""
        self.frozen = (self.sensors.steps if self.frozen is None else self.frozen) if stuck else None

    def shown_temperature(self) -> int:
        """Temperature as it is reported [degC]."""
        return round(self.temperature if self.forced_temperature is None else self.forced_temperature)

    def measure(self, winding: float) -> None:
        """Velocity and temperature, one :data:`TICK` after the last time.

        Args:
            winding: resistance of the winding [ohm].
        """
        sensors = self.sensors
        self._history = [*self._history[-VELOCITY_TICKS:], sensors.steps]
        if len(self._history) > VELOCITY_TICKS:
            self._velocity = (sensors.steps - self._history[0]) / (VELOCITY_TICKS * TICK)
        heat = winding * sensors.current**2
        self.temperature += TICK / HEAT_CAPACITY * (heat - (self.temperature - AMBIENT) / HEAT_RESISTANCE)

    @property
    def moves(self) -> bool:
        """Whether it turns fast enough to count as moving."""
        return abs(self._velocity) * self.model.step >= MOVING

    def outside(self, volts: float) -> bool:
        """Whether a supply voltage [V] is outside the limits in the servo."""
        low, high = self.get(self._role("min_voltage")), self.get(self._role("max_voltage"))
        return not low <= round(volts * 10) <= high


def share(count: int, factory: int) -> float:
    """A setting over that of the factory; 1 where the factory's is none."""
    return count / factory if factory else 1.0
