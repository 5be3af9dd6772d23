"""The finder against the hidden bench.

Effects that it must name, nulls where it must name nothing, strangers that it must not name.

``python -m benchmarks.hidden`` runs everything and writes ``benchmarks/results/hidden.{json,md,png}``. Finished cases
are kept in ``hidden.jsonl`` beside them while it runs, so that it can be stopped and resumed. Seeds below 900 are for
development; reported runs use seeds that were not looked at before: from 900, 950 and 970 on, a part of those from 995
on, and from 1020 on. Their effects have the sizes of a table; ``--drawn`` draws size and sign of each anew, and what
else an effect has (ripple count, stiffness of teeth), and writes ``hidden_drawn``.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.kept import RESULTS, Kept, command, study

if TYPE_CHECKING:
    from sealegs.gap.measure.named import NamedCause
    from sealegs.gap.search.result import Search
    from sealegs.gap.verdict.verdict import JointDiagnosis

REPORTED_SEED = 1020
TOLERANCE = 0.05  # up to which the nominal numbers may be wrong without that being a finding
NULLS = 40
LOADS = ("light", "medium", "heavy")
PAIRS = (
    ("friction.load_dependent", "drive.delay"),
    ("friction.coulomb", "transmission.backlash"),
    ("friction.stribeck", "load.mass"),
    ("drive.supply_sag", "friction.viscous"),
    ("transmission.compliance", "friction.coulomb"),
    ("drive.deadband", "friction.load_dependent"),
    ("sensor.delay", "load.inertia"),
    ("drive.gain", "friction.asymmetric"),
    ("drive.rate_limit", "friction.coulomb"),
    ("sensor.offset", "friction.load_dependent"),
)
SURE = 0.9
"""Confidence from which a wrong name counts as wrong with confidence."""


@dataclass(frozen=True)
class Case:
    """One hidden bench: its effects with magnitudes (none: a null), and its seed."""

    effects: tuple[tuple[str, str], ...]
    seed: int
    drawn: bool = False

    @property
    def key(self) -> str:
        """Name in the results."""
        names = " + ".join(f"{name}:{size}" for name, size in self.effects)
        return f"{names}{' drawn' if self.drawn else ''} #{self.seed}"

    def values(self) -> dict[str, dict[str, float] | str | float]:
        """Magnitude of each effect, or the value that is drawn for it."""
        from testbed import drawn

        rng = np.random.default_rng([self.seed, 1])
        return {name: drawn(name, size, rng) if self.drawn else size for name, size in self.effects}


def cases(
    names: Sequence[str], magnitudes: Sequence[str], seeds: int, first: int, *, drawn: bool = False
) -> list[Case]:
    """Cases in a fixed order; each has a seed of its own.

    Args:
        names: of effects and strangers; ``null`` and ``pairs`` stand for these.
        magnitudes: of effects and strangers; pairs are ``clear``.
        seeds: cases per effect and magnitude.
        first: seed of the first case.
        drawn: with effects of random size and sign.
    """
    from testbed import MAGNITUDES

    plain = [name for name in names if name not in ("null", "pairs")]
    found = [
        Case(((name, size),), first + 1000 * k + 100 * MAGNITUDES.index(size) + repeat, drawn)
        for size in magnitudes
        for k, name in enumerate(all_names())
        if name in plain
        for repeat in range(seeds)
    ]
    if "null" in names:
        found += [Case((), first + 50_000 + k) for k in range(NULLS)]
    if "pairs" in names:
        found += [
            Case(((a, "clear"), (b, "clear")), first + 60_000 + 100 * k + repeat, drawn)
            for k, (a, b) in enumerate(PAIRS)
            for repeat in range(seeds)
        ]
    return found


def all_names() -> list[str]:
    """Effects and strangers of the hidden bench, in its order."""
    from testbed import EFFECTS, STRANGERS

    return [*EFFECTS, *STRANGERS]


def run(case: Case, look_on: bool = False, **recording: Any) -> dict[str, Any]:
    """Record and diagnose one case.

    Args:
        case: what is hidden.
        look_on: also fit rounds that the search would skip, for ``benchmarks.sensitivity``.
        recording: of the bench, where it is not the usual one (:func:`testbed.hidden_bench`).
    """
    from sealegs.gap.finder.diagnosis import diagnose
    from sealegs.gap.search.record import to_dict

    from testbed import drawn_constants, hidden_bench

    constants = drawn_constants(np.random.default_rng([case.seed, 2])) if case.drawn else {}
    data, truth = hidden_bench(case.values(), case.seed, LOADS, constants=constants, **recording)
    began = time.perf_counter()
    (found,) = diagnose(data, look_on=look_on)
    seconds = time.perf_counter() - began
    return {
        "key": case.key,
        "revision": revision(),
        "effects": {name: {**truth["effects"][name], "magnitude": size} for name, size in case.effects},
        "true_noise": truth["noise_floor"],
        "factors": truth["nominal_factors"],
        "seconds": seconds,
        "verdict": found.verdict,
        "gap": {name: error.rmse for name, error in found.gap.items()},
        "unexplained": found.unexplained,
        "structure": None
        if found.structure is None
        else {
            "level": found.structure.level,
            "noticed": found.structure.noticed,
            "predicted": found.structure.predicted,
            "depends_on": [name for name, _ in found.structure.depends_on],
        },
        "causes": [row_of(cause) for cause in found.causes]
        + [
            {
                "name": error.name,
                "kind": "data",
                "share": 0.0,
                "confidence": 1.0,
                "rivals": [],
                "parameters": {path: [v.value, v.low, v.high, v.nominal] for path, v in error.values.items()},
            }
            for error in found.data_errors
        ],
        "limits": limits_of(found),
        "rounds": [] if found.search is None else [_margins(found.search, k) for k in range(len(found.search.rounds))],
        "record": None if found.search is None else to_dict(found.search.record),
    }


Limits = Mapping[str, Sequence[float | None]]
"""By cause between which values it would not show, and the nominal one; None for an end that there is not."""


def row_of(cause: NamedCause) -> dict[str, Any]:
    """A named cause as benches keep it."""
    return {
        "name": cause.name,
        "joint": cause.joint,
        "kind": cause.kind,
        "share": cause.share,
        "gain": cause.gain,
        "confidence": cause.confidence,
        "standing": cause.standing,
        "rivals": list(cause.rivals),
        "parameters": {path: [v.value, v.low, v.high, v.nominal, v.unit] for path, v in cause.parameters.items()},
    }


def limits_of(found: JointDiagnosis) -> Limits:
    """What a diagnosis says of what it could not have found; JSON has no infinity."""
    ends = {one.name: (one.low, one.high, one.nominal) for one in found.limits}
    return {name: [float(x) if np.isfinite(x) else None for x in row] for name, row in ends.items()}


def hides(limits: Limits, name: str, value: float) -> bool:
    """Whether a diagnosis that found nothing says that a cause of this size would not show."""
    if name not in limits:
        return False
    low, high, *_ = limits[name]  # rows of before have no third
    return (low is None or low < value) and (high is None or value < high)


def revision() -> str:
    """The last commit to what is judged and what judges it, with a ``+`` where files differ; ``?`` without git."""
    from sealegs.agents.run_folder import git_revision

    found = git_revision("gap", "actuators", "testbed")
    return "?" if found["revision"] is None else found["revision"][:7] + "+" * found["changed"]


def _margins(search: Search, number: int) -> dict[str, Any]:
    """Squared error over that of the noise on unseen data, before a round and with each candidate of it."""
    chosen, count = search.rounds[number], float(search.counts.sum())
    return {
        "before": float(chosen.before.sum()) / count,
        "accepted": chosen.accepted,
        "after": {c.cause.name: float(c.blocks.sum()) / count for c in chosen.candidates},
        "best": {c.cause.name: c.best for c in chosen.candidates},
    }


# --- judging -----------------------------------------------------------------------------------------------------


def outcome(row: dict[str, Any]) -> str:
    """What a diagnosis of a single effect was worth.

    ``right``, ``rival``, ``nothing``, ``not identifiable``, ``unsure`` or ``wrong``.
    """
    wanted = set(row["effects"])
    found = [cause for cause in row["causes"] if cause["kind"] != "data"]
    data = {cause["name"] for cause in row["causes"] if cause["kind"] == "data"}
    if not found:
        if wanted & data:
            return "right"
        return "nothing" if row["verdict"] == "nothing to explain" else "not identifiable"
    first = found[0]
    if row["verdict"] == "not identifiable":
        reported = {first["name"], *first["rivals"]} if first["rivals"] else set()
        return "rival" if wanted & reported else "not identifiable"
    if first["name"] in wanted:
        return "right"
    if wanted & set(first["rivals"]):
        return "rival"
    return "wrong" if first["confidence"] >= SURE else "unsure"


TRUE_VALUES = {
    "friction.coulomb": ("friction.coulomb", lambda v, n: v + n("coulomb", 0.052)),
    "friction.viscous": ("friction.viscous", lambda v, n: v + n("viscous", 0.059)),
    "friction.drag": ("friction.drag", lambda v, n: v),
    "friction.stribeck": ("friction.stribeck", lambda v, n: v),
    "friction.asymmetric": ("friction.asymmetry", lambda v, n: v),
    "friction.load_dependent": ("friction.load", lambda v, n: v),
    "friction.position_dependent": ("friction.ripple", lambda v, n: v),
    "friction.presliding": ("friction.bristle_stiffness", lambda v, n: v),
    "drive.gain": ("position_p.gain", lambda v, n: v * 5.3),
    "drive.derivative": ("derivative.gain", lambda v, n: v),
    "drive.delay": ("delay.seconds", lambda v, n: v + n("command_delay", 0.005)),
    "drive.rate_limit": ("rate_limit.speed", lambda v, n: v),
    "drive.acceleration_limit": ("rate_limit.acceleration", lambda v, n: v),
    "drive.goal_filter": ("goal_filter.time_constant", lambda v, n: v),
    "drive.deadband": ("dead_band.width", lambda v, n: v),
    "drive.saturation": ("duty_limit.limit", lambda v, n: v),
    "drive.offset": ("offset.value", lambda v, n: v),
    "drive.supply_sag": ("supply.resistance", lambda v, n: v),
    "drive.thermal": ("thermal.loss", lambda v, n: v),
    "drive.motor_constant": ("dc_motor.motor_constant", lambda v, n: v * n("motor_constant", 1.2)),
    "drive.minimum_duty": ("minimum_duty.value", lambda v, n: v),
    "drive.overload": ("torque_limit.limit", lambda v, n: v),
    "drive.integer_gain": ("duty_step.size", lambda v, n: v),
    "transmission.backlash": ("backlash.width", lambda v, n: v),
    "transmission.compliance": ("compliance.stiffness", lambda v, n: v),
    "transmission.gear_ratio": ("gear_ratio.factor", lambda v, n: v),
    "load.mass": ("load.mass_factor", lambda v, n: v),
    "load.inertia": ("load.extra_inertia", lambda v, n: v),
    "load.centre_of_mass": ("load.centre_shift", lambda v, n: v),
    "sensor.offset": ("encoder.offset", lambda v, n: v),
    "sensor.scale": ("encoder.scale", lambda v, n: v),
    "sensor.delay": ("encoder.latency", lambda v, n: v),
    "spring.stiffness": ("spring.stiffness", lambda v, n: v * 12.0),
    "contact.blocked": ("load.stop_angle", lambda v, n: v),
}
"""Parameter of the finder, and its true value from the hidden one and the hidden nominal values."""


def coverage(row: dict[str, Any]) -> tuple[bool, float] | None:
    """Whether the interval of the right cause's parameter covers the truth, and the value's relative error.

    None where it has none.
    """
    for name, effect in row["effects"].items():
        path, true = TRUE_VALUES.get(name, (None, None))
        cause = next((c for c in row["causes"] if c["name"] == name and path in c["parameters"]), None)
        if cause is None or true is None:
            return None
        value, low, high, *_ = cause["parameters"][path]
        truth = true(effect["value"], lambda key, nominal: row["factors"][key] * nominal)
        return low <= truth <= high, abs(value - truth) / abs(truth)
    return None


def bounded(row: dict[str, Any]) -> bool | None:
    """Whether the bound holds that was told of what is hidden ("below ... would not show").

    None where none was told: "at all", on the side where the truth is, bounds nothing.
    """
    if len(row["effects"]) != 1:
        return None
    ((name, effect),) = row["effects"].items()
    limits: Limits = row.get("limits", {})
    if name not in TRUE_VALUES or name not in limits:
        return None
    _, true = TRUE_VALUES[name]
    truth = true(effect["value"], lambda key, nominal: row["factors"][key] * nominal)
    low, high, nominal = limits[name]
    below = truth < nominal if nominal is not None else high is None
    return None if (low if below else high) is None else hides(limits, name, truth)


NUMBERS: dict[str, dict[str, Callable[[float, float], float]]] = {
    "friction.coulomb": {"coulomb": lambda v, n: n + v / 0.052},
    "friction.viscous": {"viscous": lambda v, n: n + v / 0.059},
    "drive.motor_constant": {"motor_constant": lambda v, n: n * v},
    "drive.delay": {"command_delay": lambda v, n: n + v / 0.005},
    "load.inertia": {"armature": lambda v, n: n + v / 0.026},  # on a rigid joint both are one number
    "transmission.gear_ratio": {"motor_constant": lambda v, n: n * v, "armature": lambda v, n: n * v * v},
}
"""Hidden effects that do no more than change numbers which the finder's nominal model has: the factor on each such
number, from the hidden value and the hidden factor of the nominal one."""


def within_tolerance(row: dict[str, Any]) -> bool:
    """Whether all that is hidden is numbers of the nominal model, none further off than any number may be.

    Such a case is one of the nulls, by another name: nothing is there to find.
    """
    if len(row["effects"]) != 1:
        return False
    ((name, effect),) = row["effects"].items()
    factors = [factor(effect["value"], row["factors"][number]) for number, factor in NUMBERS.get(name, {}).items()]
    return bool(factors) and all(abs(factor - 1.0) <= TOLERANCE for factor in factors)


def said(row: dict[str, Any]) -> str:
    """A case in a line."""
    names = ", ".join(f"{c['name']} {c['confidence']:.2f}" for c in row["causes"]) or "-"
    return f"{outcome(row)}; {row['verdict']}: {names}"


@study
def main() -> int:
    """Command line."""
    from benchmarks.hidden_report import write_bench

    parser = command(__doc__)
    parser.add_argument("--effects", nargs="+", help="names, 'null' and 'pairs'; default: all")
    parser.add_argument("--magnitudes", nargs="+", default=["clear", "moderate", "faint"])
    parser.add_argument("--seeds", type=int, default=1, help="cases per effect and magnitude")
    parser.add_argument(
        "--first", type=int, default=REPORTED_SEED, help="seed of the first case; below 900 for development"
    )
    parser.add_argument("--drawn", action="store_true", help="draw the size and the sign of each effect")
    parser.add_argument(
        "--look-on", action="store_true", help="also fit rounds that the search skips, for benchmarks.sensitivity"
    )
    parser.add_argument("--jobs", type=int, default=1, help="cases at a time")
    parser.add_argument(
        "--out", type=Path, help="kept cases, the summary beside it; default: hidden.jsonl or hidden_drawn.jsonl"
    )
    options = parser.parse_args()
    wanted = options.effects or [*all_names(), "null", "pairs"]
    kept = Kept(options.out or RESULTS / ("hidden_drawn.jsonl" if options.drawn else "hidden.jsonl"))
    every = cases(wanted, options.magnitudes, options.seeds, options.first, drawn=options.drawn)
    todo, now = [case for case in every if case.key not in kept], revision()
    if (old := {row.get("revision", "?") for row in kept.rows} - {now}) and todo:
        print(f"{kept.file} holds cases of revision {', '.join(sorted(old))}, this is {now}: name another file.")
        return 2
    kept.run(partial(run, look_on=options.look_on), todo, said, options.jobs)
    print(write_bench(kept.rows, kept.file.with_suffix("")))
    return 0


if __name__ == "__main__":
    sys.exit(main())
