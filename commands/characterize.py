"""Characterise a servo on a brake bench: torque as a linear map of duty and speed.

    sealegs characterize actuator=sts3215         the printed protocol on a virtual bench
    sealegs characterize table=measured.csv       the measurements of a real bench
    sealegs train actuator=runs/<folder>/chain.yaml

Follows "Practical Approach to Characterize Realistic Motor Dynamics" (III-B and C). PWM goes from -0.9 to 0.9 by 0.05,
load from 0 to 1.2 N.m by 0.05, temperature takes 40, 55 and 70 degC; each point is measured three times, in random
order. Stalls, and measurements beyond two standard deviations of the line of their PWM, are dropped. Writes table.csv,
fit.json, chain.yaml and fit.png.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..common.atomic import fresh


def main(arguments: list[str]) -> None:
    """Measure or read, fit, write."""
    from ..actuators.brake_bench import Noise, Protocol, measure  # here, so that --help does not wait
    from ..actuators.brake_report import chain_from, report
    from ..actuators.chain import load_chain
    from ..actuators.regression_fit import fit_regression, read_table
    from ..configs.check import Count, Natural, checked
    from ..configs.compose import compose, split

    config = compose("characterize", split(arguments, plain=("actuator", "table", "out"), first="table"))
    table_path = config["table"]
    if table_path is not None:
        chain, label = None, Path(str(table_path)).stem
        table = read_table(Path(str(table_path)))
    else:
        chain = load_chain(config["actuator"])
        label = chain.label
        numbers = {key: _number(f"noise.{key}", value) for key, value in config["noise"].items()}
        count = config["repeats"]
        repeats = checked("repeats", count, Count, f"repeats is {count}; each point must be measured at least once.")
        seed = checked("seed", config["seed"], Natural, f"seed is {config['seed']}; it must not be negative.")
        table = measure(chain, Protocol(repeats=repeats), Noise(**numbers), seed)
    fit = fit_regression(table)
    new = chain_from(fit, table, chain, _number("gain", config["gain"]), _number("armature", config["armature"]))
    report(Path(str(config["out"] or fresh(Path("runs"), f"characterize-{label}"))), table, fit, new, label)


def _number(key: str, value: Any) -> float:
    from ..configs.check import NotNegative, checked

    return checked(key, value, NotNegative, f"{key} is {value}; it must not be negative.")
