"""What duty and current are worth beside the position, and what is left of all of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sealegs.actuators.chain import load_chain
from sealegs.gap.causes.catalogue import adjustable
from sealegs.gap.log.parts import cut
from sealegs.gap.replay.free import FreeProblem, free_problem
from sealegs.gap.replay.joint_model import JointModel
from sealegs.gap.replay.problem import converged
from sealegs.gap.search.channels import weigh_channels
from sealegs.gap.search.correlated import excess
from sealegs.gap.search.fit import fit
from sealegs.gap.search.settings import DEFAULT
from sealegs.gap.search.structure import LIMITS, structure

from testbed import NOISE_FLOOR, hidden_bench

SEED = 402
POSITION = {"position": 1.0 / NOISE_FLOOR}


def recorded(weight: dict[str, float]) -> tuple[FreeProblem, dict[str, float]]:
    """A null, and the numbers of its machine as factors on what the sidecar believes."""
    data, truth = hidden_bench({}, SEED, ("light", "medium", "heavy"))
    models = [JointModel(load_chain(run.actuators["servo"])) for run in data.runs]
    return free_problem(data.runs, "servo", models, cut(data.runs, "servo"), weight), truth["nominal_factors"]


@pytest.mark.long
def test_columns_that_a_drive_holds_for_a_quarter_of_a_millisecond_are_not_taken_for_a_longer_delay() -> None:
    bare, factors = recorded(POSITION)
    problem = weigh_channels(converged(bare))
    assert problem.weight[problem.channels.index("duty")] > 0.0
    found = fit(problem, adjustable(problem.models[0]))
    believed = problem.models[0].value("delay.seconds")
    assert abs(found.values["delay.seconds*"] - factors["command_delay"]) * believed < 1e-4
    assert structure(problem, found.simulated).level < LIMITS.noticed


@pytest.mark.long
@pytest.mark.parametrize("margin", [0.8, 1.0, 1.25])
def test_noise_is_no_excess_however_large_it_is_taken_for(margin: float) -> None:
    problem, factors = recorded(POSITION)
    problem = replace(problem, weight=problem.weight / margin)
    names = {"motor_constant": "dc_motor", "resistance": "dc_motor", "armature": "dc_motor"}
    names |= {"coulomb": "friction", "viscous": "friction"}
    true = {f"{stage}.{name}*": factors[name] for name, stage in names.items()}
    true["delay.seconds*"] = factors["command_delay"]
    right, wrong = problem.simulate([true, {**true, "friction.coulomb*": 1.4}])
    assert excess(problem, right) < DEFAULT.least_excess < 0.2 < excess(problem, wrong)


def test_an_excess_is_what_an_error_adds_to_noise() -> None:
    """Slow errors of half a noise floor add a quarter of its square; of fast ones nothing is shared."""
    problem, _ = recorded(POSITION)
    rng = np.random.default_rng(0)
    simulated = np.repeat(problem.measured[:, :1], 4, axis=1)
    noise = NOISE_FLOOR * rng.standard_normal(len(problem.time))
    slow = 0.5 * NOISE_FLOOR * np.sqrt(2.0) * np.sin(2.0 * np.pi * 0.7 * problem.time)
    levels = [excess(problem, simulated + error[:, None]) for error in (noise, noise + slow)]
    assert levels[0] < 0.01
    assert levels[1] == pytest.approx(0.25, abs=0.03)
