"""TensorBoard output of one run, over several sessions."""

from __future__ import annotations

from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from torch.utils.tensorboard.writer import SummaryWriter


class ResumableTensorBoard(TensorBoardOutputFormat):
    """TensorBoard format that takes back what a killed session wrote after its last checkpoint."""

    def __init__(self, folder: str, step: int) -> None:
        # Not the parent's constructor: it makes a writer that cannot purge.
        self.writer = SummaryWriter(log_dir=folder, purge_step=step + 1 if step else None)
        self._is_closed = False


def tensorboard_logger(folder: str, step: int) -> Logger:
    """Logger of event files in ``folder``; readers drop what an earlier session wrote there after ``step``."""
    return Logger(folder, [ResumableTensorBoard(folder, step)])
