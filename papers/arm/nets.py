"""Makes the actuator net of the arm from simulated runs of its assumed servo, not from the machine.

    python -m sealegs.papers.arm.nets

Writes ``configs/actuator/srlfj_net.npz``; a net that is there already stays. The servo of joint 1 moves inertias from
that of joint 1 to a twentieth of it, under goals like the line's and goals that jump, and under pushes.
"""

from __future__ import annotations

import sys

import numpy as np

from ...actuators import load_chain
from ...actuators.net_data import smooth_noise
from ...actuators.net_training import Settings, TrainingRun, train
from ..net_files import make_missing

RATE, SECONDS, RUNS = 500.0, 6.0, 12
STEPS = 4  # of the motion in a sample
SETTINGS = Settings(rate=RATE, history=2, hidden=(16, 16), epochs=25, patience=10)


def runs(seed: int = 0) -> list[TrainingRun]:
    """Runs with the servo's torque as target."""
    servo, rng = load_chain("srlfj_ideal1").find("ideal"), np.random.default_rng(seed)
    samples, step, found = round(SECONDS * RATE), 1.0 / (RATE * STEPS), []
    for number in range(RUNS):
        inertia = 0.25 * 20.0 ** -rng.uniform()
        reach = 0.02 * 20.0 ** rng.uniform()
        if number % 2:
            goal = reach * np.repeat(rng.uniform(-1.0, 1.0, 40), samples // 40)
        else:
            goal = reach * smooth_noise(rng, samples, RATE, rng.uniform(0.3, 3.0))
        push = 3.0 * rng.uniform() * smooth_noise(rng, samples, RATE, rng.uniform(0.5, 5.0))
        rows = np.empty((samples, 3))
        place = speed = 0.0
        for k in range(samples):
            for part in range(STEPS):
                torque = servo.stiffness * (goal[k] - place) - servo.damping * speed
                torque = min(max(torque, -servo.torque_limit), servo.torque_limit)
                if part == 0:
                    rows[k] = place, speed, torque
                speed += step * (torque + push[k]) / inertia
                place += step * speed
        time, (position, velocity, torques) = np.arange(samples) / RATE, rows.T
        found.append(TrainingRun(f"run {number}", time, goal, position, velocity, torques))
    return found


if __name__ == "__main__":
    sys.exit(make_missing({"srlfj_net": lambda: train(runs(), SETTINGS)}))
