"""The leg's controllers on the same paths, and what the rows of paper 000, section 4.4, say of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...actuators import Chain
from ...envs.leg.kinematics import angles, lengthening
from ...envs.leg.path import BOX_HIGH, BOX_LOW
from ...envs.leg.robot import chains_of
from ..published import Otherwise, Row
from .choices import CONTROL
from .control import Lines, Model, errors, rms, with_gains
from .dynamics import gravity
from .paper import Analysis, linear, needed_volts, supply_volts
from .tuning import OTHER_SECONDS, OWN_SECONDS, further, other_paths, own_paths

PID, IDEAL, PD = "PID, a search's result", "ideal servos", "PD"
WITHOUT = "PD and computed torque without friction"
WITH = "PD and computed torque with friction"
SLIDING = "with Coulomb and viscous friction alone"
WHOLE = "the same, with the whole perturbation (25)"
MASSLESS = "with friction, of a massless leg"
SLICK = "without friction in the leg: "
WITHIN, ALL = f"within {supply_volts():g} V", f"all {len(other_paths())} paths"
SIGNIFICANT, ALIKE = 2.0, 1.1  # times the other error
MOST = 0.95  # share of the paths on which a statement has to hold


def perturbation_lines(analysis: Analysis) -> Lines:
    """(29) and (30), fitted over the box of the environment's paths."""
    points = np.random.default_rng(0).uniform(BOX_LOW, BOX_HIGH, (2000, 3))
    q = angles(analysis.values, points)
    reach, weight = lengthening(analysis.values, q), gravity(analysis.constants, q)
    (m2, b2), (m3, b3) = (linear(reach, weight[:, j]) for j in (1, 2))
    return Lines((0.0, m2, m3), (0.0, b2, b3))


def within_supply(analysis: Analysis, commands: np.ndarray) -> np.ndarray:
    """Which paths (n, 7) the assumed supply can follow (n,): no motor needs more than its voltage."""
    volts = supply_volts()
    return np.array([needed_volts(analysis.in_time(row[:6].reshape(2, 3), float(row[6]))) <= volts for row in commands])


def figures(off: np.ndarray, able: np.ndarray) -> dict[str, Any]:
    """Errors (samples, n) [m] as ``rms`` and ``largest``, of the paths that the supply can follow and of all.

    ``beyond`` is how many paths it cannot follow, ``paths`` the root mean square on each.
    """
    kept = off[:, able]
    of_all = {"rms_all": rms(off), "largest_all": float(off.max())}
    each = np.sqrt(np.mean(np.square(off), axis=0)).tolist()
    return {"rms": rms(kept), "largest": float(kept.max()), **of_all, "beyond": float((~able).sum()), "paths": each}


def controllers(analysis: Analysis, seconds: float) -> dict[str, dict[str, Any]]:
    """:func:`figures` of each controller on the same paths."""
    command, lines = other_paths(), perturbation_lines(analysis)
    able, direct = within_supply(analysis, command), chains_of("silo4_pd")
    slick = {name: chain.without_stage("meshing") for name, chain in direct.items()}
    cases: dict[str, tuple[Mapping[str, Chain], Model | None]] = {
        PID: (chains_of("silo4"), None),
        IDEAL: (chains_of("silo4_ideal"), None),
        PD: (direct, None),
        WITHOUT: (direct, Model(lines, friction=False)),
        WITH: (direct, Model(lines, friction=True)),
        SLIDING: (direct, Model(lines, friction="sliding")),
        WHOLE: (direct, Model("whole", friction=True)),
        MASSLESS: (direct, Model(None, friction=True, inertia="rotors")),
        SLICK + PD: (slick, None),
        SLICK + WITHOUT: (slick, Model(lines, friction=False)),
    }
    return {
        name: figures(errors(chains, command, seconds, model=model), able) for name, (chains, model) in cases.items()
    }


def search_on(analysis: Analysis, evaluations: int) -> dict[str, dict[str, dict[str, Any]]]:
    """Figures of the shipped PID, and of one that so many more simulations find, on own and on other paths."""
    gains, preview = further(evaluations)
    found = {}
    for name, command, seconds in (("own", own_paths(), OWN_SECONDS), ("other", other_paths(), OTHER_SECONDS)):
        able = within_supply(analysis, command)
        found[name] = {
            "shipped": figures(errors(chains_of("silo4"), command, seconds), able),
            "searched": figures(errors(with_gains(gains), command, seconds, preview), able),
        }
    return found


def control_rows(tracking: Mapping[str, Mapping[str, Any]]) -> list[Row]:
    """What is compensated, and what that is worth, on each path."""
    known = "the model that compensates is the one that moves: a machine's friction is known less well"

    def times(name: str, where: str, worse: str, better: str, alike: bool = False, note: str = known) -> Row:
        ratio = np.array(tracking[worse]["paths"]) / np.array(tracking[better]["paths"])
        low, median, high = np.quantile(ratio, (1.0 - MOST, 0.5, MOST))
        whole, every = (tracking[worse][key] / tracking[better][key] for key in ("rms", "rms_all"))
        tail = f"{MOST:.0%} under {high:.3g}" if alike else f"{MOST:.0%} over {low:.3g}"
        limit = "a tenth more" if alike else "twice the"
        return Row(
            name, where, "yes", f"median {median:.3g} times the error, {tail}, {ratio.min():.3g} to {ratio.max():.3g}",
            "predicted", agrees=bool(high < ALIKE if alike else low > SIGNIFICANT),
            judged=f"assumed: {limit} error, on {MOST:.0%} of the paths", rests=CONTROL, note=note,
            sensitivity=(
                Otherwise(f"rms of the paths {WITHIN}", f"{whole:.3g} times the error"),
                Otherwise(f"rms of {ALL}", f"{every:.3g} times the error"),
            ),
        )  # fmt: skip

    micro = {name: 1e6 * tracking[name]["rms"] for name in (WITHOUT, WITH, WHOLE, MASSLESS)}
    return [
        times("leaving friction out yields significant errors in control", "4.3.2", WITHOUT, WITH),
        times("a friction model with static and meshing friction is required", "2.2", SLIDING, WITH),
        times("the simplified perturbation loses no accuracy in control", "4.3.2, (28) to (30)", WITH, WHOLE, True,
              f"{micro[WITH]:.1f} for {micro[WHOLE]:.1f} um; with friction left out, {micro[WITHOUT]:.0f} um"),
        times("legs as massless systems are not the best option: their dynamics improve control", "4, 5", MASSLESS,
              WITH, note=f"{micro[MASSLESS]:.1f} for {micro[WITH]:.1f} um"),
    ]  # fmt: skip


def tracking_lines(tracking: Mapping[str, Mapping[str, float]]) -> list[str]:
    """The controllers as lines of text."""
    width = max(map(len, tracking)) + 2
    lines = [
        f"{'error of the foot [mm]':{width}s}{f'paths {WITHIN}':>19s}{ALL:>19s}",
        " " * width + f"{'rms':>10s}{'largest':>9s}" * 2,
    ]
    for name, row in tracking.items():
        cells = [(row["rms"], row["largest"]), (row["rms_all"], row["largest_all"])]
        lines.append(f"{name:{width}s}" + "".join(f"{1e3 * a:10.3f}{1e3 * b:9.3f}" for a, b in cells))
    return [*lines, ""]


def search_lines(search: Mapping[str, Mapping[str, Mapping[str, float]]], evaluations: int) -> list[str]:
    """What more of the search takes off the PID's error."""
    lines = [f"rms of the PID [mm], shipped and after {evaluations} more simulations of its search"]
    for name, key in (("own", "rms"), ("other", "rms"), ("other", "rms_all")):
        before, after = (search[name][which][key] for which in ("shipped", "searched"))
        label = f"{name} paths" + (", all" if key == "rms_all" else f", {WITHIN}")
        lines.append(f"  {label:26s}{1e3 * before:.4f} to {1e3 * after:.4f}, {after / before - 1.0:+.0%}")
    return [*lines, ""]
