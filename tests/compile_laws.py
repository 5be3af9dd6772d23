"""Compile once what takes numba a minute, before the workers of a test run start: each would compile it for itself."""

from __future__ import annotations

import multiprocessing
import sys
import time
from collections.abc import Callable


def engine() -> None:
    """The laws in the engine's callback."""
    import gymnasium

    bench = gymnasium.make("sealegs:SeaLegs/Bench-v0")
    bench.reset(seed=0)
    bench.step(bench.action_space.sample())
    bench.close()


def free_joint() -> None:
    """The replay of a joint that its torque moves."""
    from sealegs.actuators.chain import load_chain
    from sealegs.gap.log.parts import cut
    from sealegs.gap.replay.free import free_problem
    from sealegs.gap.replay.joint_model import JointModel

    from testbed import hidden_bench

    bench, _ = hidden_bench({}, runs=1, duration=1.0)
    models = [JointModel(load_chain(run.actuators["servo"])) for run in bench.runs]
    free_problem(bench.runs, "servo", models, cut(bench.runs, "servo"), {"position": 1.0}).simulate([{}])


def driven_joint() -> None:
    """The replay of a joint that moves as it was measured."""
    from sealegs.actuators.chain import load_chain
    from sealegs.gap.log.parts import cut
    from sealegs.gap.replay.driven import driven_problem
    from sealegs.gap.replay.joint_model import JointModel

    from testbed import hidden_hopper

    hopper, _ = hidden_hopper({}, runs=1, duration=1.0)
    models = [JointModel(load_chain(run.actuators["hip"])) for run in hopper.runs]
    driven_problem(hopper.runs, "hip", models, cut(hopper.runs, "hip"), 1.0).simulate([{}])


def _each(parts: tuple[Callable[[], None], ...]) -> None:
    for part in parts:
        part()


def compile_laws() -> None:
    """Run everything that is compiled, shortly, on two cores; with the compiled code on disk it takes seconds."""
    began = time.perf_counter()
    with multiprocessing.get_context("spawn").Pool(2) as pool:  # each about as long
        pool.map(_each, [(engine, driven_joint), (free_joint,)], chunksize=1)
    if (seconds := time.perf_counter() - began) > 10.0:
        print(f"Compiled the laws in {seconds:.0f} s; they stay on disk until their sources change.", file=sys.stderr)


if __name__ == "__main__":
    compile_laws()
