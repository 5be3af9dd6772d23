"""TensorBoard output of one run, over several sessions."""

from __future__ import annotations

import time
from pathlib import Path

from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat
from torch.utils.tensorboard.writer import SummaryWriter


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
