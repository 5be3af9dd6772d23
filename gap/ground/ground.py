"""The ground's share of a legged gap: contact causes, sought on top of what the joints were found to be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...actuators import Chain, load_chain
from ...actuators.errors import SealegsError
from ..log.finding import Finding
from ..log.parts import FIT_A, FIT_B, held_out
from ..log.progress import Progress
from ..log.types import LogError, MeasuredRun
from ..replay.parameters import Parameter, numbers
from ..search.fit import fit
from ..search.forward import Searcher
from ..search.result import Search
from ..search.settings import DEFAULT, SearchSettings
from .causes import contact_causes, ground_numbers
from .leg_model import LegModel
from .leg_problem import LegProblem, leg_problem
from .leg_replay import JOINTS
from .stances import column_noise, find_stances

GROUND = "ground"
PILOT = 6  # iterations
FEWEST = 9  # stances, three for each part of the data
VISIBLE = 0.1  # mean squared change of the errors, in parts of the noise, from which an effect shows


@dataclass(frozen=True, eq=False)
class GroundSearch:
    """What a search of the ground under a leg found.

    Attributes:
        problem: the stances.
        search: of the contact causes.
        numbers: of the ground, tuned and refitted alike.
        noise: of the columns.
    """

    problem: LegProblem
    search: Search
    numbers: tuple[Parameter, ...]
    noise: np.ndarray

    def findings(self, values: Mapping[str, float], *, complete: bool) -> list[Finding]:
        """What these stances would not show beside the parameters that were found.

        Args:
            values: of the extended leg.
            complete: whether the actuator of every joint was diagnosed.
        """
        found = _blind(self.problem, values, np.isfinite(self.noise))
        if not complete:
            found.append(
                Finding(
                    "contact.joints", "warning", GROUND, None,
                    "Not every joint could be diagnosed, so errors of its actuator may look like the ground.",
                )
            )  # fmt: skip
        return found


def search_ground(
    runs: Sequence[MeasuredRun],
    chains: Mapping[str, Chain],
    seed: int,
    progress: Progress,
    test_group: str | None = None,
    causes: Sequence[str] | None = None,
    settings: SearchSettings = DEFAULT,
    look_on: bool = False,
) -> GroundSearch | str:
    """Seek contact causes under a leg, on top of what its joints were found to be.

    Args:
        runs: of one machine.
        chains: of the joints that were diagnosed, as found; of the others the sidecar is believed.
        seed: of all resampling.
        progress: is told what goes on.
        test_group: group of runs that no fit and no choice may see.
        causes: names of those to consider; default: all of the ground's.
        settings: thresholds of the search.
        look_on: whether it records rounds that it would skip.

    Returns:
        The search, or a sentence that says why the log shows nothing of the ground.

    Raises:
        SealegsError: the sidecar's numbers are none of the robot's, or the test group does not exist.
    """
    held = held_out(runs, test_group)
    if not all(np.isfinite(run.base.get("z", np.nan)).any() for run in runs):
        return "the height of the base was not logged; record it as base.z (a boom encoder or a camera)."
    if any(dict(run.robot_params) != dict(runs[0].robot_params) for run in runs):
        return "the runs are of legs with different robot_params; diagnose them apart."
    try:
        leg = LegModel.of(
            runs[0].robot_params, {name: chains.get(name) or load_chain(runs[0].actuators[name]) for name in JOINTS}
        )
    except SealegsError as error:
        raise LogError(f"{runs[0].name}: {error}") from None
    hidden = [
        name for name in JOINTS if leg.gives_way(name) and any(r.joints[name].link_position is None for r in runs)
    ]
    if hidden:
        columns = " and ".join(f"{name}.link_position" for name in hidden)
        return f"the links behind the springs were not logged; record {columns}."
    progress("looking for stances")
    noise = column_noise(runs)
    stances = find_stances(runs, leg, noise)
    if len(stances) < FEWEST:
        return (
            f"the leg left the ground {len(stances)} times for long enough, and {FEWEST} stances are needed; "
            "let it hop for longer."
        )
    tested = sum(stance.run in held for stance in stances)
    if held and (tested < FEWEST // 3 or len(stances) - tested < FEWEST - FEWEST // 3):
        return (
            f"of {len(stances)} stances {tested} are in the group '{test_group}'; {FEWEST // 3} are needed there to "
            f"test on and {FEWEST - FEWEST // 3} in the others to fit on."
        )
    problem = leg_problem(runs, leg, stances, noise, test_group)
    progress(f"replaying {len(stances)} stances")
    tuned = tuple(ground_numbers(leg))
    problem = problem.weighed(_pilot(problem, leg, tuned))
    search = Searcher(problem, contact_causes(leg, causes), tuned, progress, seed, settings, look_on).run()
    return GroundSearch(problem, search, tuned, noise)


def _pilot(problem: LegProblem, leg: LegModel, tuned: Sequence[Parameter]) -> dict[str, float]:
    """A ground with everything fitted at once: it explains nothing, but the stances run on it about as they did."""
    every = [parameter for cause in contact_causes(leg) for parameter in cause.variants[0]]
    believed = {p.path: min(p.neutral(leg), p.high) for p in every}
    return fit(problem.part(FIT_A, FIT_B), [*tuned, *every], believed, PILOT).values


def _blind(problem: LegProblem, values: Mapping[str, float], logged: np.ndarray) -> list[Finding]:
    """Causes that these stances would hardly show beside what was found, and columns that were missed."""
    named = set(numbers(values))
    every = {cause.name: cause.plausible for cause in contact_causes(problem.models[0])}
    sizes = {name: change for name, change in every.items() if not named & set(numbers(change))}
    names = list(sizes)
    simulated = problem.simulate([values, *({**values, **change} for change in sizes.values())])
    errors = problem.residual(simulated)
    change = np.mean((errors[1:] - errors[0]) ** 2, axis=1)
    hidden = [name for name, size in zip(names, change, strict=True) if size < VISIBLE]
    found = []
    if hidden:
        found.append(
            Finding(
                "contact.unseen", "note", GROUND, None,
                f"These stances would hardly show {' or '.join(hidden)}: the foot stays far from its limits. Hop "
                "higher, or push harder forward and back.",
            )
        )  # fmt: skip
    if not logged[1]:
        found.append(
            Finding(
                "contact.columns", "note", GROUND, "base.x",
                "base.x was not logged: friction and slope show through the links alone, and are less certain.",
            )
        )  # fmt: skip
    return found
