"""The ground's share of a legged gap: contact causes, sought on top of what the joints were found to be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...actuators import Chain
from ...envs.hopper.robot import HOPPER
from ..experiment.proposal import VISIBLE_DIFFERENCE
from ..log.finding import Finding
from ..log.parts import FIT_A, FIT_B
from ..log.progress import Progress
from ..log.types import MeasuredRun
from ..replay.parameters import Parameter, numbers
from ..search.fit import fit
from ..search.forward import Searcher
from ..search.result import Search
from ..search.settings import DEFAULT, SearchSettings
from .leg_ground import lay_leg
from .problem import GroundProblem, Laid
from .tree_ground import lay_robot, stands

GROUND = "ground"


@dataclass(frozen=True, eq=False)
class GroundSearch:
    """What a search of the ground under a robot found.

    Attributes:
        laid: the pieces of its log, and what was sought in them.
        problem: the same, weighed for the ground that was found at first.
        search: of the contact causes.
    """

    laid: Laid
    problem: GroundProblem
    search: Search

    @property
    def numbers(self) -> tuple[Parameter, ...]:
        """Of the ground, tuned and refitted alike."""
        return self.laid.tuned

    def findings(self, values: Mapping[str, float], *, complete: bool) -> list[Finding]:
        """What these pieces would not show beside the parameters that were found.

        Args:
            values: of the extended robot.
            complete: whether the actuator of every joint was diagnosed.
        """
        found = [*_blind(self.laid, self.problem, values), *self.laid.findings]
        if not complete and self.laid.needs_joints:
            found.append(
                Finding(
                    "contact.joints", "warning", GROUND, None,
                    "Not every joint could be diagnosed, so errors of its actuator may look like the ground.",
                )
            )  # fmt: skip
        return found


def on_ground(runs: Sequence[MeasuredRun]) -> bool:
    """Whether runs are of a robot that stands on a ground: a hopper, or any whose base moves."""
    return all(run.robot == HOPPER.name for run in runs) or stands(runs[0])


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
    """Seek contact causes under a robot, on top of what its joints were found to be.

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
    if any(dict(run.robot_params) != dict(runs[0].robot_params) for run in runs):
        return "the runs are of robots with different robot_params; diagnose them apart."
    lay = lay_leg if runs[0].robot == HOPPER.name else lay_robot
    laid = lay(runs, chains, progress, test_group)
    if isinstance(laid, str):
        return laid
    progress(f"replaying {len(laid.problem.units)} {laid.pieces}")
    problem = laid.problem.weighed(_pilot(laid))
    search = Searcher(problem, laid.causes(causes), laid.tuned, progress, seed, settings, look_on).run()
    return GroundSearch(laid, laid.told(problem), search)


def _pilot(laid: Laid) -> dict[str, float]:
    """A ground with everything fitted at once: it explains nothing, but the pieces run on it about as they did."""
    nominal = laid.problem.models[0]
    every = [parameter for cause in laid.causes(None) for parameter in cause.variants[0]]
    believed = {p.path: min(p.neutral(nominal), p.high) for p in every}
    return fit(laid.problem.part(FIT_A, FIT_B), [*laid.tuned, *every], believed, DEFAULT.sketched_iterations).values


def _blind(laid: Laid, problem: GroundProblem, values: Mapping[str, float]) -> list[Finding]:
    """Causes that these pieces would hardly show beside what was found."""
    named = set(numbers(values))
    every = {cause.name: cause.plausible for cause in laid.causes(None)}
    sizes = {name: change for name, change in every.items() if not named & set(numbers(change))}
    names = list(sizes)
    simulated = problem.simulate([values, *({**values, **change} for change in sizes.values())])
    errors = problem.residual(simulated)
    change = np.mean((errors[1:] - errors[0]) ** 2, axis=1)
    hidden = [name for name, size in zip(names, change, strict=True) if size < VISIBLE_DIFFERENCE**2]
    if not hidden:
        return []
    return [
        Finding(
            "contact.unseen", "note", GROUND, None,
            f"These {laid.pieces} would hardly show {' or '.join(hidden)}: {laid.advice}",
        )
    ]  # fmt: skip
