"""Which servos are on a bus, how they are, and whether they are set up to be worked with; shows and sets registers.

    sealegs scan port=/dev/ttyUSB0                            all servos, at all baud rates
    sealegs scan port=/dev/ttyUSB0 id=2                       all registers of one
    sealegs scan port=/dev/ttyUSB0 id=2 set=max_torque:500    set one, or several: set=max_torque:500,p_gain:16
    sealegs scan port=/dev/ttyUSB0 id=1 new_id=7              with one servo connected, when several have the id 1
    sealegs scan port=/dev/ttyUSB0 servo=xl330_m288           Dynamixels
    sealegs scan port=/dev/ttyUSB0 id=2 reboot=true           restart one; its torque goes off, its faults are forgotten

No torque is switched on, and a scan writes nothing but what set= and new_id= name. set= takes no register that moves a
servo: torque, goals, and speed and acceleration of a move.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable

from rich.progress import track

from ..actuators.errors import SealegsError
from ..configs.script import run
from .bus import ServoBus
from .packets import BusError, ConfigurationError, PortError, WrongModelError, faults
from .registers import ServoModel, load_model, model_names

TIMEOUT = 0.02  # [s] for a reply, until it is known how fast this adapter is
TRIES = 3  # a servo that is asked for by its id is not given up for one reply that came late


def rows(bus: ServoBus, ids: Iterable[int], say: Callable[[str], None] = print) -> int:
    """Print a line for each servo that answers, and a sentence for what is wrong with one; how many there are.

    Raises:
        PortError: the port failed; what is wrong with a servo keeps no other from being found.
    """
    protocol = bus.model.protocol
    names = {load_model(name).model_number: name for name in model_names() if load_model(name).protocol == protocol}
    count = 0
    for number in ids:
        try:
            for servo, model in bus.scan([number]).items():
                if not count:
                    say(
                        f"{'id':>4}  {'model':<15} {'firmware':<9} {'voltage':<8} {'temperature':<12} {'step':<6} "
                        f"{'torque':<7} baud rate"
                    )
                count += 1
                if names.get(model) != bus.model.name:
                    say(f"{servo:>4}  {names.get(model, 'unknown')} ({model}); give servo=<its table> to read it")
                    continue
                _row(bus, servo, model, say)
        except PortError:
            raise
        except BusError as error:
            count += 1
            say(f"{number:>4}  {error}")
    return count


def _row(bus: ServoBus, servo: int, model: int, say: Callable[[str], None]) -> None:
    seen = bus.identity(servo)
    state = bus.read_state([servo])
    firmware = str(seen[bus.model.role("firmware_major") or "id"])
    if "firmware_minor" in seen:
        firmware += f".{seen['firmware_minor']}"
    say(
        f"{servo:>4}  {f'{bus.model.name} ({model})':<15} {firmware:<9} {f'{state.voltage[0]:.1f} V':<8} "
        f"{f'{state.temperature[0]:.0f} degC':<12} {state.raw['present_position'][0]:<6} "
        f"{'on' if seen['torque_enable'] else 'off':<7} {bus.line.port.baudrate}"
    )
    for fault in faults([servo], [int(state.status[0])]):
        say(f"      {fault}")
    try:
        bus.check([servo])
    except (ConfigurationError, WrongModelError) as error:
        say(f"      {error}")


def show(bus: ServoBus, servo: int, say: Callable[[str], None] = print) -> None:
    """Print every register of a servo: count, value in its unit, and the factory's count where it differs."""
    for name, count in bus.identity(servo).items():
        register = bus.model[name]
        value = f"{count * register.scale:g} {register.unit}" if register.unit else ""
        factory = f"(from the factory {register.default})" if count != register.default != 0 else ""
        say(f"  {name:<22} {count:>6}  {value:<14} {factory}".rstrip())


def put(bus: ServoBus, servo: int, wanted: str, say: Callable[[str], None] = print) -> None:
    """Set registers, ``name:count`` with commas between.

    Raises:
        SealegsError: a name or count is none, or would move the servo; nothing is written then.
        BusError: a servo does not take it.
    """
    pairs = []
    for item in wanted.split(","):
        name, _, count = item.partition(":")
        if not count.strip().lstrip("-").isdigit():
            raise SealegsError(f"set={wanted} is not understood: give register:count, such as set=max_torque:500.")
        bus.model[name.strip()].encode(int(count))
        _refuse_motion(bus.model, name.strip(), int(count))
        pairs.append((name.strip(), int(count)))
    for name, count in pairs:
        before = bus.read_register(servo, name)
        bus.write_register(servo, name, count)
        say(f"Servo {servo}: {name} {count} (before: {before}).")


def _refuse_motion(model: ServoModel, name: str, count: int) -> None:
    """Nobody watches a servo once a scan is over: torque would drive it to a goal that it may have had for hours.

    Raises:
        SealegsError: the register moves a servo, and the count does not take its torque.
    """
    moving = name in model.move or name.startswith("goal_") or (name == "torque_enable" and count != 0)
    if moving and model[name].area == "ram":
        raise SealegsError(
            f"set={name}:{count} could move the servo, which nobody would watch or stop; use sealegs deploy, such as "
            "with excitation=hold, which switches torque on where the servo stands."
        )


def main(arguments: list[str]) -> None:
    """Scan the bus that the command line names, or show or set up one servo."""
    from ..configs.check import checked
    from ..configs.compose import compose, split

    config = compose("scan", split(arguments, plain=("port", "set")))
    if config["port"] is None:
        raise SealegsError("port=<path> is missing: name the adapter's port, such as /dev/ttyUSB0.")
    last = checked("last", config["last"], int)
    reboot = checked("reboot", config["reboot"], bool)
    one, new, rate = (checked(key, config[key], int | None) for key in ("id", "new_id", "baudrate"))
    wanted = checked("set", config["set"], str | None)
    if one is None and (new is not None or wanted is not None or reboot):
        raise SealegsError("new_id=, set= and reboot= need id=: the servo that they are for.")
    model = load_model(checked("servo", config["servo"], str))
    ids = range(min(last, model.high_id) + 1) if one is None else [one]
    found, timeout, tried = 0, TIMEOUT, list[int]()
    for speed in model.baud_rates if rate is None else [rate]:
        try:
            bus = ServoBus(str(config["port"]), speed, model.name, timeout)
        except PortError:
            if rate is not None or not tried:  # the SDK does not know every rate that servos do
                raise
            continue
        tried.append(speed)
        with bus:
            if one is not None and not any(one in bus.scan([one]) for _ in range(TRIES)):
                continue
            if one is not None:
                return _single(bus, one, new, wanted, reboot)
            hidden = not sys.stdout.isatty()
            found += rows(bus, track(ids, f"Looking at {speed} bit/s", transient=True, disable=hidden))
            timeout = bus.line.round_trip.timeout(timeout)
    if not found:
        who = "no servo" if one is None else f"no servo {one}"
        raise SealegsError(
            f"{who} answers on {config['port']} at {', '.join(map(str, tried))} bit/s; check power and wiring."
        )


def _single(bus: ServoBus, servo: int, new: int | None, wanted: str | None, reboot: bool) -> None:
    if reboot:
        bus.reboot(servo)
        print(f"Servo {servo} restarts; its torque is off.")
    if wanted is not None:
        put(bus, servo, wanted)
    if new is not None:
        bus.change_id(servo, new)
        print(f"Servo {servo} has the id {new} now.")
    if wanted is None and new is None and not reboot:
        show(bus, servo)


if __name__ == "__main__":
    sys.exit(run(main, "scan", __doc__ or "", sys.argv[1:]))
