"""Run a policy, an excitation, a log or a reference controller on servos, and log it.

    python deploy.py policy=runs/first/final robot=hopper                on a virtual machine
    python deploy.py excitation=chirp                                    an excitation of the library, on the bench
    python deploy.py excitation=diagnosis/next_experiment.csv out=logs/today
    python deploy.py policy=runs/first/final robot=hopper hw=feetech port=/dev/ttyUSB0
    python deploy.py policy=runs/first/final robot=hopper dry_run=true   print the first goals, no torque

Limits on joints, speed, current, temperature, voltage and late data hold whatever runs (configs/robot), and however a
run ends, a process of its own sees to it that the servos are released or held. The log is a measured log
(docs/log-format.md) that diagnose.py reads, complete up to the last cycle.
"""

from __future__ import annotations

from sealegs.configs.script import Interrupted

PLAIN = (
    "policy",
    "excitation",
    "replay",
    "port",
    "actuator",
    "calibration",
    "out",
    "name",
    "hw.virtual.hidden",
    "hw.virtual.faults",
)


def main(arguments: list[str]) -> None:
    """Run what the command line names."""
    from sealegs.configs.compose import compose, split  # here, so that --help does not wait for the compiled laws
    from sealegs.hw import deployment

    prepared = deployment.prepare(compose("deploy", split(arguments, PLAIN)))
    done = deployment.run(prepared)
    if done is None:
        return
    deployment.report(prepared, done)
    if done.outcome.ending == "stopped":
        why = "" if done.outcome.reason == "Ctrl-C" else f", since {done.outcome.reason}"
        rest = "released" if prepared.config["rest"] == "release" else "held"
        raise Interrupted(f"Stopped{why}; the servos are {rest}.")
