"""The comparison with the paper: runs its experiments, writes numbers and pictures beside the printed statements."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ...common.atomic import write_text
from ...common.errors import SealegsError
from ...envs.hexapod.gait import SPEED, Tripod
from ...envs.hexapod.parameters import NUMBERS
from ...envs.hexapod.robot import FRICTIONS, HORIZONTAL, KINDS, VERTICAL
from ..published import Mark, Otherwise, Row, documents, row_lines
from . import friction_bench
from .paper import (
    BREAKAWAY_AT_REST,
    Machine,
    Standing,
    Walk,
    chains_with,
    friction_at_rest,
    limit_by_speed,
    penetration_on,
    stand_unpowered,
)

UNPOWERED = ("none", "dry/viscous", "LuGre")  # Fig. 8
SPEEDS = (0.01, 0.03)  # [m/s] of Fig. 12, beside the gait's own; the printed ones are not at hand
SETTLING = 0.25  # share of a cycle before the one that is measured
SETTLED = 0.2  # share of the support at its begin that no figure looks at: the reference has just stopped
AT_REST = 0.05  # [A] below which a motor's current counts as none
NO_LOAD, LOAD = "dry/viscous", "dry/viscous 2"
CHANGED: tuple[tuple[str, dict[str, float], dict[str, float]], ...] = (
    ("the chosen numbers, at 3 cm/s as all below", {}, {}),
    ("a stance 15 % lower", {}, {"stance_height": 0.85 * NUMBERS["stance_height"].value}),
    ("links with centres 20 % further out", {}, {"link_centre": 1.2 * NUMBERS["link_centre"].value}),
    ("floor friction times 0.6", {}, {"floor_friction": 0.6 * NUMBERS["floor_friction"].value}),
    ("gain of the vertical motors doubled", {"vertical.position_pi.gain": 2500.0}, {}),
)
"""Assumed numbers and other values of them: label, changes of the chains, changes of the robot."""


def _statement(printed: str, where: str, ours: str, agrees: bool, mark: Mark, **more: Any) -> Row:
    """One statement of the paper, which is its own name, beside what the simulation says."""
    return Row(printed, where, "stated", ours, mark, agrees=bool(agrees), **more)


def compare(out: Path, seconds: float = 10.0, say: Callable[[str], None] = print) -> dict[str, Any]:
    """Run the paper's experiments; write ``hexapod.json`` and six pictures into ``out``, and tell the result.

    Args:
        out: folder; made if it is not there.
        seconds: that the robot stands with its motors at 0 V [s]; the gait takes the cycles that it needs.
        say: prints a line.

    Raises:
        SealegsError: the folder has results already, or the time is too short to sink in.
    """
    if seconds < 1.0:
        raise SealegsError(f"seconds is {seconds:g}; at least 1 is needed for a robot to sink visibly.")
    if (out / "hexapod.json").exists():
        raise SealegsError(f"{out} holds a comparison already; give another folder as out=.")
    out.mkdir(parents=True, exist_ok=True)
    depth = penetration_on(3)
    standing: dict[str, Standing] = {}
    for name in UNPOWERED:
        say(f"standing {seconds:g} s with motors at 0 V, joint friction: {name}")
        standing[name] = stand_unpowered(name, seconds)
    walks: dict[str, Walk] = {}
    for name in FRICTIONS:
        say(f"walking at {100 * SPEED:g} cm/s, joint friction: {name}")
        walks[name] = Machine(name).walk(Tripod(), 2.0)
    resistance = sweep(walks, say)
    others = changed(say)
    say("friction of six vertical joints from motor currents")
    identified = friction_bench.identify()
    rows = [
        *statements(depth, standing, walks, resistance, seconds, others),
        *friction_bench.identification_rows(identified),
    ]
    result = {
        "rows": documents(rows),
        "identified_friction": {name: np.asarray(value).tolist() for name, value in asdict(identified).items()},
        "sinking_m": {name: row.sinking for name, row in standing.items()},
        "penetration_m": depth,
        "motors_of_leg_0": {name: motors(walk) for name, walk in walks.items()},
        "specific_resistance": {
            name: {f"{v:g}": value for v, value in row.items()} for name, row in resistance.items()
        },
        "shares_in_transfer_and_support": {name: walk.shares() for name, walk in walks.items()},
        "gait": asdict(Tripod()),
        "chains": {
            name: {joint: chain.to_list() for joint, chain in chains_with(name).items() if joint.startswith("leg0")}
            for name in FRICTIONS
        },
        "breakaway_at_rest_N": BREAKAWAY_AT_REST,
        "numbers": {name: asdict(number) for name, number in NUMBERS.items()},
        "seconds": seconds,
    }
    write_text(out / "hexapod.json", json.dumps(result, indent=1) + "\n", replace=True)
    from . import paper_plots  # matplotlib is slow to load

    paper_plots.plot_standing(standing, out / "height.png")
    paper_plots.plot_friction(standing["LuGre"], out / "friction.png")
    limit = limit_by_speed(friction_at_rest(), standing["LuGre"].speed)
    paper_plots.plot_limit(standing["LuGre"], limit, out / "limit.png")
    paper_plots.plot_motors(walks, VERTICAL, out / "vertical.png")
    paper_plots.plot_motors(walks, HORIZONTAL, out / "horizontal.png")
    paper_plots.plot_resistance(resistance, out / "resistance.png")
    for line in table(rows, walks, resistance):
        say(line)
    pictures = ("height", "friction", "limit", "vertical", "horizontal", "resistance")
    names = ("hexapod.json", *(f"{name}.png" for name in pictures))
    say("Written: " + ", ".join(f"{out}/{name}" for name in names))
    return result


def sweep(walks: Mapping[str, Walk], say: Callable[[str], None]) -> dict[str, dict[float, float]]:
    """Specific resistance by joint friction and heading velocity [m/s]; ``walks`` are those at the gait's own."""
    resistance: dict[str, dict[float, float]] = {}
    for name, walk in walks.items():
        say(f"specific resistance, joint friction: {name}")
        values = {SPEED: walk.resistance()}
        for speed in SPEEDS:
            values[speed] = Machine(name).walk(Tripod(speed), 1.0 + SETTLING).resistance()
        resistance[name] = dict(sorted(values.items()))
    return resistance


def changed(say: Callable[[str], None]) -> dict[str, tuple[Otherwise, ...]]:
    """What the statements on load and on LuGre become with other assumed numbers, by the quantity; all at 3 cm/s."""
    fast = Tripod(max(SPEEDS))
    found: dict[str, list[Otherwise]] = {"resistance": [], "current": []}
    for label, chains, params in CHANGED:
        say(f"walking at {100 * fast.speed:g} cm/s with {label}")
        walks = {name: Machine(name, chains, params).walk(fast, 1.0 + SETTLING) for name in (NO_LOAD, "LuGre", LOAD)}
        alike = abs(walks["LuGre"].resistance() / walks[NO_LOAD].resistance() - 1.0)
        found["resistance"].append(Otherwise(label, f"within {alike:.1%}"))
        along = {name: motors(walks[name])["horizontal current"]["support rms"] for name in (NO_LOAD, LOAD)}
        found["current"].append(Otherwise(label, f"{along[LOAD]:.2f} A over {along[NO_LOAD]:.2f} A"))
    return {name: tuple(values) for name, values in found.items()}


def motors(walk: Walk) -> dict[str, dict[str, float]]:
    """Currents [A] and voltages [V] of leg 0 in transfer and support of the last cycle: root mean square, and median of
    the size, which does not see the moments of lifting off and of a load beyond the breakaway force.
    """
    cycle = walk.cycle(-1)
    phase, air = walk.gait.phase(0, walk.time[cycle]), walk.gait.transfer
    parts = {"transfer": phase < air, "support": phase > air + SETTLED * (1.0 - air)}
    rows: dict[str, dict[str, float]] = {}
    for kind in (VERTICAL, HORIZONTAL):
        for quantity, values in (("current", walk.current), ("voltage", walk.voltage)):
            column = walk.quantity(values, kind)[cycle]
            rows[f"{kind} {quantity}"] = {
                f"{part} {label}": float(of(column[chosen]))
                for part, chosen in parts.items()
                for label, of in (("rms", _rms), ("median", lambda x: np.median(np.abs(x))))
            }
    return rows


def breaking_loose(walk: Walk) -> tuple[float, float, float]:
    """When the vertical motor of leg 0 draws more than :data:`AT_REST` in the support of the last cycle.

    Returns:
        The share of the support in which it does, its largest current [A], and the mean load on the foot then, over
        that in the rest of the support.
    """
    cycle = walk.cycle(-1)
    phase, air = walk.gait.phase(0, walk.time[cycle]), walk.gait.transfer
    support = phase > air + SETTLED * (1.0 - air)
    current = np.abs(walk.quantity(walk.current, VERTICAL)[cycle][support])
    load, drawn = walk.contact[cycle][support, 0], current > AT_REST
    if drawn.all() or not drawn.any():
        return float(drawn.mean()), float(current.max()), float("nan")
    return float(drawn.mean()), float(current.max()), float(load[drawn].mean() / load[~drawn].mean())


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def statements(
    depth: float,
    standing: Mapping[str, Standing],
    walks: Mapping[str, Walk],
    resistance: Mapping[str, Mapping[float, float]],
    seconds: float,
    others: Mapping[str, tuple[Otherwise, ...]],
) -> list[Row]:
    """The paper's statements beside ours."""
    sinking = {name: 1e3 * row.sinking for name, row in standing.items()}
    enough = seconds  # [mm] 10 in 10 s, as the robot sinks at a constant speed
    settled = standing["LuGre"]
    balance = abs(settled.friction[-1] / settled.load[-1] - 1.0)
    measured = {name: motors(walk) for name, walk in walks.items()}
    up = {name: row["vertical current"]["support median"] for name, row in measured.items()}
    share, largest, heavier = breaking_loose(walks["LuGre"])
    along = {name: row["horizontal current"]["support rms"] for name, row in measured.items()}
    swing = {name: measured[name]["horizontal current"]["transfer rms"] for name in (NO_LOAD, "LuGre", LOAD)}
    at = {name: row[SPEED] for name, row in resistance.items()}
    alike = max(abs(resistance["LuGre"][v] / resistance[NO_LOAD][v] - 1.0) for v in resistance["LuGre"])
    better = 1.0 - at[NO_LOAD] / at[LOAD]
    falling = min(sinking["none"], sinking["dry/viscous"])
    return [
        _statement(
            "feet sink 2.3 mm into the ground on three legs",
            "4.2.1",
            f"{1e3 * depth:.2f} mm",
            abs(1e3 * depth - 2.3) < 0.1,
            "fitted",
        ),
        _statement(
            "motors at 0 V: altitude constant with LuGre",
            "6",
            f"{sinking['LuGre']:.2f} mm in {seconds:g} s",
            sinking["LuGre"] < 1.0,
            "fitted",
        ),
        _statement(
            "not with dry/viscous, nor without friction",
            "6",
            f"{sinking['dry/viscous']:.1f} and {sinking['none']:.1f} mm",
            falling > enough,
            "fitted",
        ),
        _statement(
            "LuGre balances gravity after a small transient",
            "6",
            f"{settled.friction[-1]:.0f} N, off by {balance:.1%}",
            balance < 0.01,
            "fitted",
        ),
        _statement(
            "no vertical current in support with LuGre",
            "7.2.1",
            f"median {1e3 * up['LuGre']:.0f} mA",
            up["LuGre"] < AT_REST,
            "fitted",
        ),
        _statement(
            "but with dry/viscous, for regulation",
            "7.2.1",
            f"median {1e3 * up[NO_LOAD]:.0f} mA",
            up[NO_LOAD] > 10.0 * up["LuGre"],
            "predicted",
        ),
        _statement(
            "slight current as the load on leg 0 grows",
            "7.2.1",
            f"in {share:.0%} of it, at {heavier:.1f} times the load, {largest:.2f} A",
            0.0 < share < 0.5 and heavier > 1.0,
            "predicted",
        ),
        _statement(
            "load dependence raises the horizontal current in support",
            "7.2.1",
            f"{along[LOAD]:.2f} A over {along[NO_LOAD]:.2f} A",
            along[LOAD] > 1.2 * along[NO_LOAD],
            "predicted",
            sensitivity=others["current"],
        ),
        _statement(
            "transfer alike with dry/viscous, LuGre, dry/viscous 2",
            "7.2.1",
            ", ".join(f"{value:.2f}" for value in swing.values()) + " A",
            max(swing.values()) < 1.1 * min(swing.values()),
            "predicted",
        ),
        _statement(
            "specific resistance of LuGre as of dry/viscous",
            "7.3",
            f"within {alike:.1%}",
            alike < 0.1,
            "predicted",
            sensitivity=others["resistance"],
        ),
        _statement("35 % better without load dependence", "7.3", f"{better:.0%}", abs(better - 0.35) < 0.03, "fitted"),
    ]


def table(rows: list[Row], walks: Mapping[str, Walk], resistance: Mapping[str, Mapping[float, float]]) -> list[str]:
    """The comparison as lines of text."""
    lines = row_lines("paper 001", rows)
    lines.append("motors of leg 0, root mean square    " + "".join(f"{name:>15s}" for name in walks))
    measured = {name: motors(walk) for name, walk in walks.items()}
    for quantity in next(iter(measured.values())):
        unit = "A" if quantity.endswith("current") else "V"
        for part in ("transfer", "support"):
            values = "".join(f"{row[quantity][f'{part} rms']:15.2f}" for row in measured.values())
            lines.append(f"{quantity + ', ' + part:33s} [{unit}] {values}")
    lines.append("specific resistance")
    for speed in next(iter(resistance.values())):
        lines.append(
            f"  at {100 * speed:4.2f} cm/s{'':23s}" + "".join(f"{row[speed]:15.2f}" for row in resistance.values())
        )
    lines.append(f"of that, at {100 * SPEED:g} cm/s")
    shares = [walk.shares() for walk in walks.values()]
    for kind in KINDS:
        for k, part in enumerate(("transfer", "support")):
            lines.append(f"  {f'{kind}, {part}':35s}" + "".join(f"{row[kind][k]:15.2f}" for row in shares))
    return [*lines, ""]
