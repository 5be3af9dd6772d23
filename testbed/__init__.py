"""Machines that hide effects: the finder under test must name them, and their size.

Two machines, each with equations of motion, integrator and way of sticking of its own:

    hidden_bench({"friction.load_dependent": "clear"}, seed=1)   a servo with a pendulum, three runs
    hidden_hopper({"contact.slope": 0.05}, seed=1)               a hopping leg of two servos on a ground

Each returns the measured logs, whose sidecars believe in the nominal machine, and the truth. An effect (`EFFECTS`,
`STRANGERS` for what the catalogue of causes lacks) is hidden by its magnitude (``clear``, ``moderate``, ``faint``) or
its value; equal seeds give equal logs. ``physics`` and ``excitation`` are the bench, ``effects`` what it can hide,
``calibrate`` the sizes; ``hopper`` is the leg, ``biped_drive`` a drive of the biped on a brake bench.

The finder may not be tested by its own model. So nothing here knows sealegs: recordings are plain arrays
(:class:`~testbed.recording.Recording`). Only ``logs`` turns them into measured logs and imports their type.
"""

from .bench import LOADS, NOISE_FLOOR, nominal_chain
from .effects import EFFECTS, MAGNITUDES, STRANGERS, drawn, drawn_constants
from .logs import hidden_bench, hidden_hopper, hidden_wide, run_again
from .physics import Machine, simulate

__all__ = [
    "EFFECTS",
    "LOADS",
    "MAGNITUDES",
    "NOISE_FLOOR",
    "STRANGERS",
    "Machine",
    "drawn",
    "drawn_constants",
    "hidden_bench",
    "hidden_hopper",
    "hidden_wide",
    "nominal_chain",
    "run_again",
    "simulate",
]
