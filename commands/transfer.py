"""Measure whether training on a diagnosed model pays: one recipe, several models, all judged on hidden machines.

    sealegs transfer                                        as configs/transfer.yaml has it; hours
    sealegs transfer robots=[bench] machines=2 seeds=1      a small one
    sealegs transfer out=runs/transfer-mine                 go on with it after a stop or a kill

The machines are those of the testbed, which comes with a checkout: plants with code of their own. Each is recorded and
diagnosed. The task track is learnt on the model as believed, with two randomisations made by hand, on the extended
model, on machines drawn from the diagnosis, and on the machine itself, which is the limit. Every policy is judged on
the machine. Writes transfer.md, transfer.json and a picture for each robot; finished parts are kept in the folder.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ..common.errors import SealegsError
from ..configs.script import Interrupted


def main(arguments: list[str]) -> None:
    """Run the study that the command line asks for."""
    from ..configs.compose import compose, split  # here, so that --help does not wait for torch
    from ..evaluation.transfer.study import TABLE, run

    config = compose("transfer", split(arguments, plain=("out",)))
    study, workers = study_of(config)
    out = Path(str(config["out"]))
    try:
        run(study, out, workers, lambda text: print(text, flush=True))
    except KeyboardInterrupt:
        raise Interrupted(f"Stopped; finished parts are in {out}. Go on with the same command.") from None
    print((out / TABLE).read_text(encoding="utf-8"))
    print(f"Written: {out}")


def study_of(config: dict[str, Any]) -> tuple[Any, int]:
    """The study that a config describes, and the processes that it may use.

    Raises:
        SealegsError: a value of the wrong type or size.
    """
    from ..common.processes import cores
    from ..configs.check import Count, Natural, checked, or_null
    from ..evaluation.transfer.cells import TREATMENTS, Recipe
    from ..evaluation.transfer.study import Study

    loss = checked("least_loss", config["least_loss"], float)
    if not 0.0 <= loss < 1.0:
        raise SealegsError(f"least_loss is {loss:g}; it is a share: from 0 to less than 1.")
    recipe = Recipe(
        checked("total_timesteps", config["total_timesteps"], or_null(Count)),
        checked("n_envs", config["n_envs"], or_null(Count)),
        checked("episodes", config["episodes"], Count),
        tuple(checked("arguments", config["arguments"], list[str])),
    )
    treatments = checked("treatments", config["treatments"], or_null(list[str]))
    study = Study(
        tuple(checked("robots", config["robots"], list[str])),
        checked("machines", config["machines"], Count),
        checked("seeds", config["seeds"], Count),
        checked("seed", config["seed"], Natural),
        loss,
        TREATMENTS if treatments is None else tuple(treatments),
        recipe,
    )
    return study, checked("workers", config["workers"], or_null(Count)) or cores()
