"""What an effect that nobody modelled costs a policy: which ones matter for which task.

    python -m benchmarks.effects_on_policies                      a policy of each task, where a row is missing
    python -m benchmarks.effects_on_policies hopper/seed0         one
    python -m benchmarks.effects_on_policies --again              all anew

A policy acts in the environment of its training, on the chains of its training with one effect more, from the same
starts. Sizes are those of everyday servos, assumed: they are given beside the result. ``track`` is the reference of
``env=track`` on the bench, without learning. What a policy that was trained with the effect would earn is not told
here: a loss that training cannot undo is in the row, too.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from sealegs.actuators import Chain, load_chain
from sealegs.agents.make_env import checked_env, make_vec_env
from sealegs.agents.policy_files import episode_rewards, load_policy, trained_env
from sealegs.agents.training import half_interval
from sealegs.common.errors import SealegsError
from sealegs.common.markdown import page, table
from sealegs.envs.described.robot_described import largest_torque
from sealegs.hw.virtual.machine import changed

from benchmarks.kept import POLICIES, command, read, study, write

EPISODES = 16
TRACK = "track"
POLICIES_OF = ("hopper/seed0", "leg/seed0", "arm/seed0", "biped/seed0", "biped_hopping/seed0", "hexapod/seed0", TRACK)
LATENCY, LOST, WEAKER, SOFTER, PLAY, FRICTION, OFFSET = 0.02, 0.15, 0.8, 0.8, 0.026, 0.05, 0.035
"""Assumed sizes: [s]; share of the supply's voltage; of the motor constant; of the position gain; [rad]; share of the
largest torque at rest; [rad]."""
MATTERS = 0.05  # share of the reward from which a loss is marked


def scaled(*paths: str, factor: float) -> Callable[[Chain], Chain | None]:
    """The first of some parameters times ``factor``; None of a chain that has none of them."""

    def change(chain: Chain) -> Chain | None:
        for path in paths:
            stage, _, key = path.partition(".")
            if (found := chain.find(stage)) is not None:
                return chain.with_value(path, factor * found.parameters()[key])
        return None

    return change


def added(path: str, amount: Callable[[Chain], float]) -> Callable[[Chain], Chain | None]:
    """A parameter and ``amount`` more; the stage is put in where a chain lacks it."""
    stage, _, key = path.partition(".")

    def change(chain: Chain) -> Chain | None:
        found = chain.find(stage)
        return changed(chain, path, (0.0 if found is None else found.parameters()[key]) + amount(chain), path)

    return change


EFFECTS: Mapping[str, Callable[[Chain], Chain | None]] = {
    f"latency +{1e3 * LATENCY:g} ms": added("delay.seconds", lambda _: LATENCY),
    f"supply -{100 * LOST:g} %": scaled(
        "supply.volts", "regression.duty_torque", "ideal.torque_limit", factor=1.0 - LOST
    ),
    f"motor constant -{100 * (1 - WEAKER):.0f} %": scaled("dc_motor.motor_constant", factor=WEAKER),
    f"position gain -{100 * (1 - SOFTER):.0f} %": scaled(
        "position_p.gain", "position_pi.gain", "ideal.stiffness", factor=SOFTER
    ),
    f"dry friction +{100 * FRICTION:g} % of stall": added("friction.coulomb", lambda c: FRICTION * largest_torque(c)),
    f"backlash {PLAY:g} rad": added("backlash.width", lambda _: PLAY),
    f"zero off by {OFFSET:g} rad": added("encoder.offset", lambda _: OFFSET),
    "spring -30 %": scaled("spring.stiffness", "compliance.stiffness", factor=0.7),
}


def still(seen: np.ndarray) -> np.ndarray:
    """Actions of 0 (n, 1), of a robot with one joint."""
    return np.zeros((len(seen), 1))


def measured(name: str, effect: str | None) -> list[float] | None:
    """Episode rewards of a policy on machines with an effect; None where its chains cannot have that."""
    if name == TRACK:
        env = checked_env({"id": "SeaLegs/Track-v1", "robot": "bench"})
        env |= make_vec_env(env, None, 1, 0).engine.fitted  # the lead of the chain that is believed
        believed = {"joint": load_chain("sts3215")}
        act: Any = still
    else:
        act, description = load_policy(POLICIES / name)
        env = trained_env(description, POLICIES / name, None)
        believed = {joint: load_chain(list(stages)) for joint, stages in description["actuators"].items()}
    chains = {joint: chain if effect is None else EFFECTS[effect](chain) for joint, chain in believed.items()}
    if any(chain is None for chain in chains.values()):
        return None
    try:
        machine = make_vec_env(env, {joint: chain.to_list() for joint, chain in chains.items() if chain}, EPISODES, 0)
    except SealegsError as refused:  # such as play behind a motor without inertia
        print(f"{name}, {effect}: {refused}", file=sys.stderr)
        return None
    return [round(float(value), 3) for value in episode_rewards(act, machine)]


def loss(alone: list[float], hit: list[float]) -> tuple[float, float]:
    """Mean loss as a share of the mean reward alone, and half of its 95 % interval, from the same starts."""
    lost = (np.array(alone) - np.array(hit)) / abs(float(np.mean(alone)))
    return float(lost.mean()), half_interval(lost)


def told(rows: Mapping[str, Mapping[str, list[float] | None]]) -> str:
    """The results as a page of Markdown."""
    lines = []
    for name, found in rows.items():
        alone = found["none"]
        assert alone is not None
        cells = [name, f"{np.mean(alone):.4g}"]
        for effect in EFFECTS:
            hit = found.get(effect)
            if hit is None:
                cells.append("")
                continue
            share, half = loss(alone, hit)
            said = f"{round(100 * share)} % (+-{round(100 * half)})"
            cells.append(f"**{said}**" if share - half > MATTERS else said)
        lines.append(cells)
    return page(
        "What an effect costs a policy that was trained without it",
        f"Share of the mean episode reward that is lost, with its 95 % interval over {EPISODES} starts; bold: surely "
        f"more than {100 * MATTERS:.0f} %. Empty: the task's chains have no such number. "
        "`python -m benchmarks.effects_on_policies`",
        table(("policy", "reward", *EFFECTS), lines),
    )


@study
def main() -> None:
    """Measure, print and write."""
    parser = command(__doc__)
    parser.add_argument("policies", nargs="*", help=f"such as biped/seed0; default: {', '.join(POLICIES_OF)}")
    parser.add_argument("--again", action="store_true", help="measure rows that are there anew")
    arguments = parser.parse_args()
    rows: dict[str, Any] = read("effects_on_policies", {})
    for name in arguments.policies or POLICIES_OF:
        found = {} if arguments.again else rows.get(name, {})
        for effect in ("none", *EFFECTS):
            if effect not in found:
                found[effect] = measured(name, None if effect == "none" else effect)
                rows[name] = found
                write("effects_on_policies", None, rows)
                mean = "-" if found[effect] is None else f"{np.mean(found[effect]):.4g}"
                print(f"{name}, {effect}: {mean}", flush=True)
        write("effects_on_policies", told(rows))


if __name__ == "__main__":
    sys.exit(main())
