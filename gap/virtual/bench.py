"""A bench that exists only in the engine, whose servo hides an effect: logs to try the tools on without hardware."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from ...actuators import Chain, load_chain
from ...envs.bench.robot import NUMBERS
from ..experiment import library
from ..log.reader import write_run
from ..log.types import JointLog, MeasuredRun
from ..replay.engine import bench, replay_in_engine
from ..replay.joint_model import JointModel
from ..replay.problem import largest_step

SAMPLE_RATE = 200.0  # [Hz] samples
STAMP_JITTER = 3e-4  # [s]
ENCODER_TICKS = 4096
ENCODER_NOISE = 4e-4  # [rad] of the encoder
ENGINE_STEP = 5e-4  # [s]
CURRENT_STEP = 0.0065  # [A] of the current register
ARM = NUMBERS["arm_mass"].value
LOADS = ({"mass": 0.25, "arm_mass": ARM, "length": 0.10}, {"mass": 0.5, "arm_mass": ARM, "length": 0.12})


def record(
    folder: Path,
    nominal: str | Chain,
    hidden: Mapping[str, float],
    seed: int = 0,
    loads: Sequence[Mapping[str, float]] = LOADS,
    excitations: Sequence[str] = ("chirp", "steps", "multisine", "slow triangle"),
) -> list[Path]:
    """Write one run per load and excitation; the sidecars know the nominal chain only.

    Args:
        folder: to write into; existing logs are never overwritten.
        nominal: chain that the sidecars believe in.
        hidden: parameters by path (``stage.parameter`` or ``load.*``) of what the bench really is.
        seed: of excitations and noise.
        loads: bench parameters.
        excitations: of :func:`sealegs.gap.experiment.library`.
    """
    chain = load_chain(nominal)
    truth = JointModel(chain).with_values(hidden)
    rng = np.random.default_rng(seed)
    written, step = [], min(ENGINE_STEP, largest_step(truth.chain))
    for number, params in enumerate(loads):
        drivetrain = bench(truth, params)
        shapes = library(0.0, 0.9, seed + number)
        for name in excitations:
            grid = np.arange(0.0, len(shapes[name]) / 100.0 - 1.0 / SAMPLE_RATE, 1.0 / SAMPLE_RATE)
            time = grid + np.clip(rng.normal(0.0, STAMP_JITTER, len(grid)), -3 * STAMP_JITTER, 3 * STAMP_JITTER)
            goal = np.interp(time, np.arange(len(shapes[name])) / 100.0, shapes[name])
            out = replay_in_engine(drivetrain, time, goal, (float(goal[0]), 0.0), step)
            position, link = (_ticks(out[:, k] + rng.normal(0.0, ENCODER_NOISE, len(time))) for k in (0, 1))
            coupled = truth.chain.find("spring") is not None
            log = JointLog(
                goal=goal,
                position=position,
                link_position=link if coupled else None,
                duty=np.asarray(np.round(out[:, 2], 3), np.float64),
                current=np.round(out[:, 3] / CURRENT_STEP) * CURRENT_STEP if chain.find("dc_motor") else None,
            )
            run = MeasuredRun(
                name=f"load{number}_{name.replace(' ', '_')}",
                time=time,
                joints={"servo": log},
                robot="bench",
                robot_params=dict(params),
                actuators={"servo": chain.label if isinstance(nominal, str) else chain.to_list()},
                meta={"machine": "virtual bench"},
            )
            written.append(write_run(run, folder))
    return written


def _ticks(angle: np.ndarray) -> np.ndarray:
    step = 2 * np.pi / ENCODER_TICKS
    return np.round(angle / step) * step
