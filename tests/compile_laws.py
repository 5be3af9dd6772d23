"""Compile once what takes numba a minute, before the workers of a test run start: each would compile it for itself."""

from __future__ import annotations

import sys
import time


def compile_laws() -> None:
    """Run everything that is compiled, shortly; with the compiled code on disk it takes two seconds."""
    import gymnasium
    from sealegs.actuators.chain import load_chain
    from sealegs.gap.log.parts import cut
    from sealegs.gap.replay.driven import driven_problem
    from sealegs.gap.replay.free import free_problem
    from sealegs.gap.replay.joint_model import JointModel

    from testbed import hidden_bench, hidden_hopper

    began = time.perf_counter()
    engine = gymnasium.make("sealegs:SeaLegs/Bench-v0")
    engine.reset(seed=0)
    engine.step(engine.action_space.sample())
    engine.close()
    bench, _ = hidden_bench({}, runs=1, duration=1.0)
    models = [JointModel(load_chain(run.actuators["servo"])) for run in bench.runs]
    free_problem(bench.runs, "servo", models, cut(bench.runs, "servo"), {"position": 1.0}).simulate([{}])
    hopper, _ = hidden_hopper({}, runs=1, duration=1.0)
    models = [JointModel(load_chain(run.actuators["hip"])) for run in hopper.runs]
    driven_problem(hopper.runs, "hip", models, cut(hopper.runs, "hip"), 1.0).simulate([{}])
    if (seconds := time.perf_counter() - began) > 10.0:
        print(f"Compiled the laws in {seconds:.0f} s; they stay on disk until their sources change.", file=sys.stderr)


if __name__ == "__main__":
    compile_laws()
