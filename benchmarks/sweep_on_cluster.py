"""A sweep on a Ray cluster of three nodes, one of which is killed in the middle: what becomes of its trials.

    python -m benchmarks.sweep_on_cluster       needs the extras sweep and fleet; about 5 minutes of one core

Three nodes of one core each run on this machine, each with its own processes, as Ray's own tests have them. A node is
killed without a word once a trial on it has a checkpoint and others are finished. Then the sweep itself is killed, and
goes on. No trial that was finished may be trained again or lost, and those that ran go on from their checkpoints.
"""

from __future__ import annotations

import importlib
import json
import multiprocessing
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from sealegs.agents.sweep import TABLE, read_sweep, sweep
from sealegs.agents.sweep_workers import reward_of
from sealegs.common.errors import SealegsError
from sealegs.common.extras import needed_for
from sealegs.common.markdown import page, table

from benchmarks.kept import command, study, write

NICENESS = "RAY_worker_niceness"  # of Ray
NODES, TRIALS = 3, 6
MEMORY = 100 * 2**20  # [B] of each node's store
PATIENCE = 1800.0  # [s] until something must have happened
ARGUMENTS = (
    "env=bench", "n_envs=16", "agent.n_steps=32", "agent.batch_size=128", "total_timesteps=20480",
    "checkpoint.every=2048", "evaluate.every=0", "agent.learning_rate=tag(log,interval(1e-4,1e-2))",
    "agent.gamma=interval(0.8,0.99)",
)  # fmt: skip


def swept(arguments: list[str], address: str, log: Path) -> None:
    """Body of the process of a sweep."""
    os.environ["RAY_ADDRESS"] = address
    with log.open("a", encoding="utf-8") as file:
        os.dup2(file.fileno(), 1)
    sweep(read_sweep(arguments))


def until(happened: Callable[[], Any], what: str) -> Any:
    """What is true as soon as it is.

    Raises:
        SealegsError: it is not in time.
    """
    end = time.monotonic() + PATIENCE
    while not (found := happened()):
        if time.monotonic() > end:
            raise SealegsError(f"After {PATIENCE:g} s there is still not {what}.")
        time.sleep(0.2)
    return found


def finished(folder: Path) -> dict[str, float]:
    """Rewards of the trials that are finished, by their names."""
    rewards = {path.name: reward_of(path) for path in sorted(folder.glob("trial*")) if path.is_dir()}
    return {name: reward for name, reward in rewards.items() if reward is not None}


def sessions(trial: Path) -> list[int]:
    """Steps at which a trial's run was begun and gone on with."""
    record = json.loads((trial / "run.json").read_text(encoding="utf-8"))
    return [session["from_step"] for session in record["sessions"]]


def half_done(folder: Path) -> list[str]:
    """Trials that have a checkpoint and no reward yet."""
    return [path.name for path in sorted(folder.glob("trial*")) if reward_of(path) is None
            and any(path.glob("checkpoints/[0-9]*/state.json"))]  # fmt: skip


def written(folder: Path, names: list[str]) -> dict[str, tuple[int, str]]:
    """When the final policies of trials were written, and what they are."""
    files = {name: folder / name / "final" / "policy.json" for name in names}
    return {name: (path.stat().st_mtime_ns, path.read_text(encoding="utf-8")) for name, path in files.items()}


def measure(out: Path) -> dict[str, Any]:
    """Sweep, kill a node and then the sweep, go on; what came of it."""
    with needed_for("A cluster"):
        cluster_of: Any = importlib.import_module("ray.cluster_utils").Cluster
    os.environ[NICENESS] = "0"  # whatever else this machine does
    node = {"num_cpus": 1, "object_store_memory": MEMORY}
    cluster = cluster_of(initialize_head=True, head_node_args={**node, "include_dashboard": False})
    nodes = [cluster.add_node(**node) for _ in range(NODES - 1)]
    folder, context = out / "swept", multiprocessing.get_context("spawn")
    begin = [*ARGUMENTS, f"trials={TRIALS}", "cluster=ray", f"out={out}", "name=swept"]

    def begun(arguments: list[str]) -> Any:
        process = context.Process(target=swept, args=(arguments, cluster.address, out / "sweep.log"))
        process.start()
        return process

    try:
        process = begun(begin)
        until(lambda: len(finished(folder)) >= 1 and len(half_done(folder)) >= NODES - 1, "a trial finished")
        before_node, running = finished(folder), half_done(folder)
        kept = written(folder, list(before_node))
        cluster.remove_node(nodes[0], allow_graceful=False)
        until(lambda: len(finished(folder)) >= len(before_node) + NODES - 1, "trials finished after a node was killed")
        until(lambda: half_done(folder), "a trial with a checkpoint")
        before_driver, cut = finished(folder), half_done(folder)
        kept = {**written(folder, list(before_driver)), **kept}
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        process = begun([f"resume={folder}", "cluster=ray"])
        process.join()
        if process.exitcode != 0:
            raise SealegsError(f"The sweep ended with status {process.exitcode}; see {out / 'sweep.log'}.")
        after = finished(folder)
        return {
            "nodes": NODES,
            "trials": TRIALS,
            "finished when a node was killed": len(before_node),
            "running then": running,
            "finished when the sweep was killed": len(before_driver),
            "running at that time": cut,
            "finished in the end": len(after),
            "finished trials that changed": [
                name for name, row in kept.items() if written(folder, [name])[name] != row
            ],
            "sessions": {name: sessions(folder / name) for name in after},
            "in the table": sum(line.startswith("| ") for line in (folder / TABLE).read_text().splitlines()) - 1,
        }
    finally:
        if process.is_alive():
            process.kill()
        cluster.shutdown()


def told(row: dict[str, Any]) -> str:
    """The result as a page of Markdown."""
    again = {name: begun for name, begun in row["sessions"].items() if len(begun) > 1}
    cells = (
        ("finished when a node was killed", row["finished when a node was killed"]),
        ("running then", ", ".join(row["running then"])),
        ("finished when the sweep itself was killed", row["finished when the sweep was killed"]),
        ("running at that time", ", ".join(row["running at that time"])),
        ("finished in the end", f"{row['finished in the end']} of {row['trials']}"),
        ("finished trials that were lost or trained again", len(row["finished trials that changed"])),
        *((f"{name} went on from step", ", ".join(f"{step:,}" for step in begun[1:])) for name, begun in again.items()),
    )
    return page(
        "A sweep on a cluster, one node of which is killed",
        f"{row['nodes']} nodes of Ray on one machine, {row['trials']} trials of `env=bench`. "
        "`python -m benchmarks.sweep_on_cluster`",
        table(("", ""), cells),
    )


@study
def main() -> None:
    """Measure, print and write."""
    command(__doc__).parse_args()
    with tempfile.TemporaryDirectory() as out:
        row = measure(Path(out))
    print(told(row))
    write("sweep_on_cluster", told(row), row)


if __name__ == "__main__":
    sys.exit(main())
