"""Callbacks of a training: stop requests, checkpoints, evaluation, reward terms, progress."""

from __future__ import annotations

import secrets
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback, EvalCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.logger import KVWriter, Logger, TensorBoardOutputFormat
from stable_baselines3.common.on_policy_algorithm import OnPolicyAlgorithm
from stable_baselines3.common.vec_env import VecEnv
from torch.utils.tensorboard.writer import SummaryWriter

from ..common.atomic import write_text
from ..common.errors import SealegsError
from ..common.extras import needed_for


class StopSignals:
    """Context in which Ctrl-C and SIGTERM set ``asked`` instead of interrupting a step; a second Ctrl-C interrupts it.

    Attributes:
        asked: whether a stop was asked for.
    """

    def __init__(self) -> None:
        self.asked = False
        self._waits = True
        self._previous: dict[int, Any] = {}

    def __enter__(self) -> StopSignals:
        if threading.current_thread() is threading.main_thread():  # Python lets no other thread set handlers
            for number in (signal.SIGINT, signal.SIGTERM):
                self._previous[number] = signal.signal(number, self._ask)
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def at_once(self) -> None:
        """From here on the first stop interrupts: nothing is in progress that would be lost.

        Raises:
            KeyboardInterrupt: a stop was requested before.
        """
        if self.asked:
            raise KeyboardInterrupt
        self._waits = False

    def _ask(self, number: int, frame: FrameType | None) -> None:
        if self.asked or not self._waits:
            raise KeyboardInterrupt
        self.asked = True
        print("\nStopping after this step; once more to stop at once.", file=sys.stderr, flush=True)


_UNKNOWN = -1  # updates of the policy that was evaluated, as in runs of earlier versions


class StopOnSignal(BaseCallback):
    """Ends the learning after the current step once a stop was asked for."""

    def __init__(self, signals: StopSignals) -> None:
        super().__init__()
        self.signals = signals

    def _on_step(self) -> bool:
        return not self.signals.asked


class Checkpoints(BaseCallback):
    """Calls ``save`` every ``every`` steps, between an update and the next rollout, when the learner is consistent."""

    def __init__(self, every: int, save: Callable[[], Any]) -> None:
        super().__init__()
        self.every = every
        self.save = save
        self._last = 0

    def _on_training_start(self) -> None:
        self._last = self.num_timesteps

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self._last >= self.every:
            self._last = self.num_timesteps
            self.save()

    def _on_step(self) -> bool:
        return True


class NewBest(BaseCallback):
    """Calls ``save`` when an evaluation beats all before it."""

    def __init__(self, save: Callable[[], Any]) -> None:
        super().__init__()
        self.save = save

    def _on_step(self) -> bool:
        self.save()
        return True


class Evaluation(EvalCallback):
    """EvalCallback that continues the evaluations of earlier sessions of a run.

    Args:
        env: simulations to evaluate in, wrapped like the training ones.
        every: steps between evaluations, over all training simulations; 0: only by calls of :meth:`evaluate`.
        episodes: per evaluation, the same ones in each: their starts and commands are drawn from ``seed``.
        seed: of the episodes.
        folder: where ``evaluations.npz`` goes.
        best: mean reward to beat, of the best policy that an earlier session saved.
        save_best: called when the mean reward is the best so far.
    """

    def __init__(
        self,
        env: VecEnv,
        every: int,
        episodes: int,
        seed: int,
        n_envs: int,
        folder: str,
        best: float,
        save_best: Callable[[], Any],
    ) -> None:
        calls = max(every // n_envs, 1) if every else 0
        super().__init__(env, NewBest(save_best), None, episodes, calls, log_path=folder, verbose=0)
        self.best_mean_reward = best
        self._updates, self._seed = _UNKNOWN, seed
        self._ended: list[dict[str, float]] = []  # episodes of the latest evaluation

    def _on_step(self) -> bool:
        # an update follows the last step of a learning, so its policy is evaluated by :meth:`evaluate` thereafter
        return self.num_timesteps >= self.model._total_timesteps or self._evaluate_if_due()

    def _evaluate_if_due(self) -> bool:
        if self.eval_freq > 0 and self.n_calls % self.eval_freq == 0:
            self._updates, self._ended = self.model._n_updates, []
            self.eval_env.seed(self._seed)
        return super()._on_step()

    @property
    def state(self) -> dict[str, Any]:
        """Evaluations so far, as a checkpoint keeps them."""
        return {
            "timesteps": list(self.evaluations_timesteps),
            "results": [[float(reward) for reward in rewards] for rewards in self.evaluations_results],
            "ep_lengths": [[int(length) for length in lengths] for lengths in self.evaluations_length],
            "updates": self._updates,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take over the evaluations of an earlier session from its checkpoint."""
        self.evaluations_timesteps = list(state["timesteps"])
        self.evaluations_results = list(state["results"])
        self.evaluations_length = list(state["ep_lengths"])
        self._updates = state.get("updates", _UNKNOWN)
        self.last_mean_reward = float(np.mean(self.evaluations_results[-1])) if self.evaluations_results else -np.inf

    def evaluate(self, model: BaseAlgorithm) -> float:
        """Evaluate ``model`` now, unless it has been since its latest update; returns the mean reward.

        The model needs a logger, but need not have learned in this session.
        """
        self.init_callback(model)
        self.num_timesteps = model.num_timesteps
        same_step = self.num_timesteps in self.evaluations_timesteps[-1:]
        if not same_step or self._updates != model._n_updates:
            if same_step:  # of the policy before the update that ended the step
                for results in (self.evaluations_timesteps, self.evaluations_results, self.evaluations_length):
                    results.pop()
            frequency, self.eval_freq = self.eval_freq, 1  # the parent evaluates when its calls divide by this
            self._evaluate_if_due()
            self.eval_freq = frequency
        return self.last_mean_reward

    def _log_success_callback(self, locals_: dict[str, Any], globals_: dict[str, Any]) -> None:
        """Asked in every step of an evaluation: note what an episode tells at its end."""
        super()._log_success_callback(locals_, globals_)
        if locals_["done"]:
            info = locals_["info"]
            self._ended.append(info.get("episode", {}) | {"failed": not info.get("TimeLimit.truncated", False)})

    def means(self, kind: str) -> dict[str, float]:
        """Means over the episodes of the latest evaluation of what they tell of a kind, by name.

        Args:
            kind: ``servo``: how hard servos were driven; ``error``: from what was asked for.
        """
        names = [name for name in (self._ended[-1] if self._ended else {}) if name.startswith(f"{kind}_")]
        return {name.removeprefix(f"{kind}_"): float(np.mean([row[name] for row in self._ended])) for name in names}

    def failures(self) -> int:
        """How many of these episodes ended before their time."""
        return sum(bool(row["failed"]) for row in self._ended)

    def rewards(self) -> np.ndarray:
        """Of the episodes of the latest evaluation (n,)."""
        return np.asarray(self.evaluations_results[-1], float)

    def of_no_action(self) -> np.ndarray:
        """Rewards of the same episodes (n,) with actions of 0: of the reference that actions correct or modulate."""
        self.eval_env.seed(self._seed)
        self._ended = []
        rewards, _ = evaluate_policy(
            NoAction(self.eval_env),  # pyright: ignore[reportArgumentType] it predicts, which is all that is asked
            self.eval_env, self.n_eval_episodes, return_episode_rewards=True, callback=self._log_success_callback,
        )  # fmt: skip
        return np.asarray(rewards)


class NoAction:
    """A policy whose actions are 0."""

    def __init__(self, env: VecEnv) -> None:
        self._shape = env.action_space.shape or ()

    def predict(self, observation: Any, state: Any = None, *_: Any, **__: Any) -> tuple[np.ndarray, Any]:
        """Actions (n, k) of observations (n, size)."""
        return np.zeros((len(observation), *self._shape), np.float32), state


class EpisodeTerms(BaseCallback):
    """Logs what episodes report at their end: the terms of the reward, summed, and the actuators' flags."""

    def __init__(self) -> None:
        super().__init__()
        self._flags: dict[str, deque[float]] = {}

    def _on_step(self) -> bool:
        for number in np.flatnonzero(self.locals.get("dones", ())):  # of which ARS tells none
            for name, value in self.locals["infos"][number].items():
                if name != "TimeLimit.truncated" and isinstance(value, bool | int | float):
                    self._flags.setdefault(name, deque(maxlen=100)).append(float(value))
        return True

    def _on_rollout_end(self) -> None:
        episodes = self.model.ep_info_buffer or ()
        for name in episodes[-1] if episodes else ():
            kind, _, rest = name.partition("_")
            if kind in ("reward", "servo", "error") and rest:
                curve = f"{kind}/{rest.partition(' [')[0]}"
                self.logger.record(curve, float(np.mean([episode[name] for episode in episodes])))
        for name, values in self._flags.items():
            self.logger.record(f"actuator/{name}", float(np.mean(values)))


class ProgressReport(BaseCallback):
    """Progress bar on a terminal; elsewhere a line every tenth of the run."""

    def __init__(self, total: int) -> None:
        super().__init__()
        self.total = total
        self._bar: Progress | None = None
        self._rewards: deque[float] = deque(maxlen=100)
        self._next_line = 0

    def _on_training_start(self) -> None:
        self._from, self._started = self.num_timesteps, time.monotonic()
        if isinstance(self.model, OnPolicyAlgorithm):  # it learns from whole rollouts, so it ends at the end of one
            rollout = self.model.n_steps * self.model.n_envs
            self.total = self._from + -(-(self.total - self._from) // rollout) * rollout
        if sys.stderr.isatty():
            columns = (BarColumn(), TextColumn("{task.description}"), TimeRemainingColumn())
            self._bar = Progress(*columns, refresh_per_second=4, transient=True)
            self._bar.add_task("", total=self.total, completed=self.num_timesteps)
            self._bar.start()
        self._next_line = self._line_after(self.num_timesteps)

    def _on_step(self) -> bool:
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], completed=self.num_timesteps)
        elif self.num_timesteps >= self._next_line:
            self._next_line = self._line_after(self.num_timesteps)
            print(f"{min(100 * self.num_timesteps // self.total, 100):3d} %  {self._text()}", flush=True)
        return True

    def _line_after(self, step: int) -> int:
        """Step of the next tenth of the run, the last one being its end."""
        tenth = max(self.total // 10, 1)
        if step >= self.total:  # ARS ends only with all of its candidates
            return step + self.total
        return (step // tenth + 1) * tenth if step + tenth <= self.total else self.total

    def _on_rollout_end(self) -> None:
        if self._bar is not None:
            self._bar.update(self._bar.task_ids[0], description=self._text())

    def _text(self) -> str:
        speed = (self.num_timesteps - self._from) / max(time.monotonic() - self._started, 1e-9)
        episodes = self.model.ep_info_buffer or ()
        reward = f", episode reward {np.mean([episode['r'] for episode in episodes]):.4g}" if episodes else ""
        return f"step {self.num_timesteps} of {self.total}, {speed:.0f} steps/s{reward}"

    def close(self) -> None:
        """Take the bar off the terminal."""
        if self._bar is not None:
            self._bar.stop()
            self._bar = None


# --- curves of a run over all its sessions: in TensorBoard, and in Weights & Biases where ``wandb=<project>`` asks ---

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
