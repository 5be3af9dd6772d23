"""What the named chains compute does not change by accident: torques along one motion, as they were recorded."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from sealegs.actuators import Chain, load_chain, load_chain_set
from sealegs.actuators.chain import names, set_names
from sealegs.actuators.law import advance, begin, torque
from sealegs.actuators.layout import P_STATE_SIZE, S_STEP

from tests.quick import quick

RECORDED = Path(__file__).parents[1] / "trajectories.json"
STEP, SAMPLES, EVERY = 0.005, 600, 50


def chains() -> dict[str, Chain]:
    """Every chain of ``configs/actuator``, those of a set by ``set:pattern``."""
    found = {name: load_chain(name) for name in names()}
    for name in set_names():
        found |= {f"{name}:{pattern}": chain for pattern, chain in (load_chain_set(name) or {}).items()}
    return found


def torques(chain: Chain) -> list[float]:
    """Torque of a chain [N.m] at every so many samples of a motion that is given."""
    time = np.arange(SAMPLES) * STEP
    goal = 0.4 * np.sin(2 * np.pi * 0.9 * time) + 0.2 * np.sign(np.sin(2 * np.pi * 0.37 * time)) * (time > 0.3)
    q = 0.35 * np.sin(2 * np.pi * 0.9 * time - 0.3)
    w = np.gradient(q, time)
    a = np.gradient(w, time)
    external = 0.3 * np.cos(3 * time)
    program = chain.program()
    state = np.zeros(int(program[P_STATE_SIZE]))
    begin(program, state, 0.0, goal[0], q[0], w[0])
    state[S_STEP] = STEP
    found, half = [], 0.5 * STEP
    for k in range(SAMPLES):
        if k:
            advance(program, state, time[k])
        value = torque(program, state, time[k], goal[k], q[k], w[k], external[k], True)
        torque(program, state, time[k] + half, goal[k], q[k] + half * w[k], w[k] + half * a[k], external[k], False)
        if k % EVERY == 0:
            found.append(float(value))
    return found


@pytest.mark.parametrize("name", quick(sorted(chains()), 8))
def test_a_chain_computes_the_torques_that_were_recorded(name):
    recorded = json.loads(RECORDED.read_text(encoding="utf-8"))
    assert name in recorded, "record it: python -m tests.actuators.test_trajectories"
    assert torques(chains()[name]) == pytest.approx(recorded[name], rel=1e-9, abs=1e-12)


def record() -> None:
    """Record chains that are new: ``python -m tests.actuators.test_trajectories``; what is recorded stays."""
    recorded = json.loads(RECORDED.read_text(encoding="utf-8"))
    found = {name: torques(chain) for name, chain in chains().items() if name not in recorded}
    rows = [f" {json.dumps(name)}: {json.dumps(values)}" for name, values in sorted({**found, **recorded}.items())]
    RECORDED.write_text("{\n" + ",\n".join(rows) + "\n}\n", encoding="utf-8")
    print(f"Recorded: {', '.join(sorted(found)) or 'nothing new'}")


if __name__ == "__main__":
    record()
