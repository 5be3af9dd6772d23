"""Which servos are on a bus, how they are, and whether they are set up to be worked with; shows and sets registers.

    sealegs scan port=/dev/ttyUSB0                            all servos, at all baud rates
    sealegs scan port=/dev/ttyUSB0 id=2                       all registers of one
    sealegs scan port=/dev/ttyUSB0 id=2 set=max_torque:500    set one, or several: set=max_torque:500,p_gain:16
    sealegs scan port=/dev/ttyUSB0 id=1 new_id=7              with one servo connected, when several have the id 1
    sealegs scan port=/dev/ttyUSB0 servo=xl330_m288           Dynamixels
    sealegs scan port=/dev/ttyUSB0 id=2 reboot=true           restart one; its torque goes off, its faults are forgotten

It says all that deploy would refuse or mention of a servo. No torque is switched on, and a scan writes nothing but what
set= and new_id= name. set= takes no register that moves a servo: torque, goals, and speed and acceleration of a move.
A servo with a lock register is restarted after set= and new_id=, if its torque is off, to see that it has kept them.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from rich.progress import track

from ...common.errors import SealegsError
from ...configs.script import run
from ..bus.adapters import advice
from ..bus.packets import BusError, NotWrittenError, PortError, faults, in_words
from ..bus.registers import ServoModel, load_model, model_names
from ..bus.servo_bus import ServoBus
from .robot import unlike_the_factory

TIMEOUT = 0.02  # [s] for a reply, until it is known how fast this adapter is
TRIES = 3  # a servo that is asked for by its id is not given up for one reply that came late


def rows(bus: ServoBus, ids: Iterable[int], say: Callable[[str], None] = print) -> int:
    """Print a line for each servo that answers, and a sentence for what is wrong with one; how many there are.

    Raises:
        PortError: the port failed; what is wrong with a servo keeps no other from being found.
    """
    protocol = bus.model.protocol
    names = {load_model(name).model_number: name for name in model_names() if load_model(name).protocol == protocol}
    names[bus.model.model_number] = bus.model.name  # of a table that is given by its path
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
    for sentence in (*bus.unfit(servo), *unlike_the_factory({f"of servo {servo}": seen}, bus.model)):
        say(f"      {sentence}")


def show(bus: ServoBus, servo: int, say: Callable[[str], None] = print) -> None:
    """Print every register of a servo: count, value in its unit, and the factory's count where it differs."""
    for name, count in bus.identity(servo).items():
        register = bus.model[name]
        value = f"{count * register.scale:g} {register.unit}" if register.unit else ""
        factory = f"(from the factory {register.default})" if count != register.default != 0 else ""
        say(f"  {name:<22} {count:>6}  {value:<14} {factory}".rstrip())


def put(bus: ServoBus, servo: int, wanted: str, say: Callable[[str], None] = print) -> None:
    """Set registers, ``name:count`` with commas between.

    Those of the EEPROM come first: a restart then shows whether the servo keeps them, and would undo the others.

    Raises:
        SealegsError: a name or count is none, or would move the servo; nothing is written then.
        BusError: a servo does not take it, or forgets it.
    """
    pairs = []
    for item in wanted.split(","):
        name, _, count = item.partition(":")
        if not count.strip().lstrip("-").isdigit():
            example = f"set={bus.model.moves[0]}:{bus.model[bus.model.moves[0]].default}"
            raise SealegsError(f"set={wanted} is not understood: give register:count, such as {example}.")
        bus.model[name.strip()].encode(int(count))
        _refuse_motion(bus.model, name.strip(), int(count))
        pairs.append((name.strip(), int(count)))
    lasting = [(name, count) for name, count in pairs if bus.model[name].area == "eeprom"]
    passing = [pair for pair in pairs if pair not in lasting]
    for part in (lasting, passing):
        for name, count in part:
            before = bus.read_register(servo, name)
            bus.write_register(servo, name, count)
            say(f"Servo {servo}: {name} {count} (before: {before}).")
        if part and part is lasting:
            _see_kept(bus, servo, dict(lasting), say)


def _see_kept(bus: ServoBus, servo: int, counts: Mapping[str, int], say: Callable[[str], None]) -> None:
    """Make sure that a servo keeps registers without power, or say that it may not.

    Raises:
        NotWrittenError: it does not.
    """
    if bus.model.role("lock") is None:
        return
    what = ", ".join(f"{name} {count}" for name, count in counts.items())
    if bus.restarted(servo) is None:
        say(_may_forget(bus, servo, what))
        return
    lost = {name: now for name, count in counts.items() if (now := bus.read_register(servo, name)) != count}
    if lost:
        raise NotWrittenError(
            f"servo {servo} has forgotten {', '.join(f'{name} {counts[name]}' for name in lost)} in a restart and has "
            f"{', '.join(f'{name} {now}' for name, now in lost.items())} again: it keeps nothing without power; use "
            "the tool of the manufacturer.",
            [servo],
        )
    say(f"Servo {servo} was restarted and has kept {what}.")


def _may_forget(bus: ServoBus, servo: int, what: str) -> str:
    return (
        f"Servo {servo} was not restarted, since its torque is on or it cannot do so: {what} may be lost at power-off. "
        f"Switch its power off and on, then look: sealegs scan port={bus.port} servo={bus.model.name} id={servo}"
    )


def give_id(bus: ServoBus, servo: int, new: int, say: Callable[[str], None] = print) -> None:
    """Give a servo another id, and make sure that it keeps it without power, or say that it may not.

    Raises:
        BusError: it does not take it, or forgets it.
    """
    bus.change_id(servo, new)
    say(f"Servo {servo} has the id {new} now.")
    if bus.model.role("lock") is None:
        return
    if (found := bus.restarted(new, [servo])) is None:
        say(_may_forget(bus, new, f"the id {new}"))
    elif found != new:
        raise NotWrittenError(
            f"servo {new} has forgotten its id in a restart and is {found} again: it keeps nothing without power; use "
            "the tool of the manufacturer.",
            [found],
        )
    else:
        say(f"Servo {new} was restarted and has kept its id.")


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
    from ...configs.check import checked
    from ...configs.compose import compose, split

    config = compose("scan", split(arguments, plain=("port", "set")))
    if config["port"] is None:
        raise SealegsError("port=<path> is missing: name the adapter's port, such as /dev/ttyUSB0.")
    if (line := advice(str(config["port"]))) is not None:
        print(line)
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
            found += rows(bus, track(ids, f"Looking at {speed} bit/s", transient=True, disable=_hidden()))
            timeout = bus.line.round_trip.timeout(timeout)
    if not found:
        raise SealegsError(_missing(str(config["port"]), model, one, ids if one is None else range(last + 1), tried))


def _missing(port: str, model: ServoModel, one: int | None, ids: Iterable[int], tried: Sequence[int]) -> str:
    """That a servo, or any, does not answer at the rates that were tried, and who does."""
    rates = f"on {port} at {', '.join(map(str, tried))} bit/s"
    if one is None:
        return f"no servo answers {rates}; check power and wiring."
    for speed in tried:
        with ServoBus(port, speed, model.name, TIMEOUT) as bus:
            shown = track(list(ids), f"Looking for others at {speed} bit/s", transient=True, disable=_hidden())
            if there := list(_who(bus, shown)):
                does = "does" if len(there) == 1 else "do"
                return f"no servo {one} answers {rates}; {in_words(there)} {does}, at {speed} bit/s."
    return f"no servo {one} answers {rates}, and no other one; check power and wiring."


def _hidden() -> bool:
    """Whether nobody sees a progress bar."""
    return not sys.stdout.isatty()


def _who(bus: ServoBus, ids: Iterable[int]) -> Iterator[int]:
    """Ids that answer, cleanly or not."""
    for number in ids:
        try:
            if number in bus.scan([number]):
                yield number
        except PortError:
            raise
        except BusError:  # a broken packet is an answer too
            yield number


def _single(bus: ServoBus, servo: int, new: int | None, wanted: str | None, reboot: bool) -> None:
    if reboot:
        bus.reboot(servo)
        print(f"Servo {servo} restarts; its torque is off.")
    if wanted is not None:
        put(bus, servo, wanted)
    if new is not None:
        give_id(bus, servo, new)
    if wanted is None and new is None and not reboot:
        show(bus, servo)


if __name__ == "__main__":
    sys.exit(run(main, "scan", __doc__ or "", sys.argv[1:]))
