"""Which servos are on a bus, how they are, and whether they are set up to be worked with; or give one another id.

    sealegs scan port=/dev/ttyUSB0
    sealegs scan port=/dev/ttyUSB0 id=1 new_id=7     with one servo connected, when several have the id 1

No torque is switched on, and a plain scan writes nothing.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable

from rich.progress import track

from ..actuators.errors import SealegsError
from ..configs.script import run
from .bus import ServoBus
from .packets import ConfigurationError, WrongModelError, faults
from .registers import load_model, model_names
from .robot import HIGHEST_ID


def rows(bus: ServoBus, ids: Iterable[int], say: Callable[[str], None] = print) -> int:
    """Print a line for each servo that answers, and a sentence for each that is not set up; how many there are."""
    names = {load_model(name).model_number: name for name in model_names()}
    count = 0
    for number in ids:
        for servo, model in bus.scan([number]).items():
            if not count:
                say(f"{'id':>4}  {'model':<15} {'firmware':<9} {'voltage':<8} {'temperature':<12} {'step':<6} torque")
            count += 1
            if names.get(model) != bus.model.name:
                say(f"{servo:>4}  {names.get(model, 'unknown')} ({model}); give servo=<its table> to read it")
                continue
            seen = bus.identity(servo)
            state = bus.read_state([servo])
            firmware = f"{seen['firmware_major']}.{seen['firmware_minor']}"
            say(
                f"{servo:>4}  {f'{bus.model.name} ({model})':<15} {firmware:<9} {f'{state.voltage[0]:.1f} V':<8} "
                f"{f'{state.temperature[0]:.0f} degC':<12} {state.raw['present_position'][0]:<6} "
                f"{'on' if seen['torque_enable'] else 'off'}"
            )
            for fault in faults([servo], [int(state.status[0])]):
                say(f"      {fault}")
            try:
                bus.check([servo])
            except (ConfigurationError, WrongModelError) as error:
                say(f"      {error}")
    return count


def main(arguments: list[str]) -> None:
    """Scan the bus that the command line names, or give a servo another id."""
    from ..configs.check import checked
    from ..configs.compose import compose, split

    config = compose("scan", split(arguments, plain=("port",)))
    if config["port"] is None:
        raise SealegsError("port=<path> is missing: name the adapter's port, such as /dev/ttyUSB0.")
    baudrate, last = (checked(key, config[key], int) for key in ("baudrate", "last"))
    old, new = (checked(key, config[key], int | None) for key in ("id", "new_id"))
    if (old is None) != (new is None):
        raise SealegsError("id= and new_id= go together: the id that a servo has, and the one that it gets.")
    with ServoBus(str(config["port"]), baudrate, checked("servo", config["servo"], str)) as bus:
        if old is not None and new is not None:
            bus.change_id(old, new)
            print(f"Servo {old} has the id {new} now.")
            return
        ids = range(min(last, HIGHEST_ID) + 1)
        found = rows(bus, track(ids, "Looking for servos", transient=True, disable=not sys.stdout.isatty()))
    if not found:
        raise SealegsError(
            f"no servo answers on {config['port']}; check power and wiring, and whether the baud rate is {baudrate}."
        )


if __name__ == "__main__":
    sys.exit(run(main, "scan", __doc__ or "", sys.argv[1:]))
