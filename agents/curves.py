"""Curves of a run over all its sessions: in TensorBoard, and in Weights & Biases where ``wandb=<project>`` asks."""

from __future__ import annotations

import secrets
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat
from torch.utils.tensorboard.writer import SummaryWriter

from ..common.atomic import write_text
from ..common.errors import SealegsError
from ..common.extras import needed_for

_ID = "wandb.txt"


class WandbOutput(KVWriter):
    """Writes what a learner logs into one run of a project, over all sessions of the run's folder."""

    def __init__(self, project: str, run: Path, config: Mapping[str, Any]) -> None:
        """Open the run.

        Args:
            project: of Weights & Biases.
            run: the run's folder; with WANDB_MODE=offline all stays in its ``wandb/``.
            config: of the run.

        Raises:
            SealegsError: the package is missing, nobody is logged in, or the service does not answer.
        """
        with needed_for(f"wandb={project}"):
            import wandb
        file = run / _ID
        if not file.is_file():
            write_text(file, secrets.token_hex(4))
        try:
            self._run = wandb.init(
                project=project, name=run.name, id=file.read_text().strip(), resume="allow", dir=str(run),
                config=dict(config), settings=wandb.Settings(console="off", silent=True),
            )  # fmt: skip
        except wandb.Error as error:
            reason = str(error).strip().partition("\n")[0].rstrip(".")
            raise SealegsError(
                f"wandb={project} does not open ({reason}): log in by `wandb login`, keep the curves here by "
                "WANDB_MODE=offline, or leave wandb= out."
            ) from None

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        """Log the numbers of one dump at ``step``."""
        numbers = {key: float(value) for key, value in key_values.items() if _is_number(value)}
        self._run.log({key: value for key, value in numbers.items() if "wandb" not in (key_excluded[key] or ())}, step)

    def close(self) -> None:
        """End the run's session."""
        self._run.finish()


def _is_number(value: Any) -> bool:
    try:
        float(value)
    except (TypeError, ValueError):
        return False
    return True


# --- TensorBoard -----------------------------------------------------------------------------------------------------


class ResumableTensorBoard(TensorBoardOutputFormat):
    """TensorBoard format that discards what a killed session wrote after its last checkpoint."""

    def __init__(self, folder: Path, step: int) -> None:
        # Not the parent's constructor: it makes a writer that cannot purge.
        self.writer = SummaryWriter(log_dir=str(folder), purge_step=step + 1 if step else None)
        self._is_closed = False


def tensorboard_logger(folder: Path, step: int, *others: KVWriter) -> Logger:
    """Logger of event files in ``folder``, and into ``others``; readers drop what an earlier session wrote there after
    ``step``."""
    for file in folder.glob("events.out.tfevents.*"):
        # Readers take the files in the order of their names, which begin with the second they were made in.
        while int(time.time()) <= int(file.name.split(".")[3]):
            time.sleep(0.1)
    return Logger(str(folder), [ResumableTensorBoard(folder, step), *others])
