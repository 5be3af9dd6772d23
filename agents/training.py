"""One training run, from the command line to the film of its policy."""

from __future__ import annotations

import contextlib
import errno
import math
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from scipy.stats import t as student
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import CallbackList

from ..common.atomic import written
from ..common.documents import read_json, read_yaml
from ..common.errors import SealegsError
from ..common.markdown import page, table
from ..configs.script import Interrupted
from ..envs.any_robot.user import is_user_task
from ..envs.engine.sb3 import BatchVecEnv
from ..envs.engine.servo_use import UNITS
from ..envs.engine.task import ModulatedTask
from .algorithms import build, callback, schedule_start, wrapped
from .callbacks import (
    Checkpoints,
    EpisodeTerms,
    Evaluation,
    ProgressReport,
    StopOnSignal,
    StopSignals,
    WandbOutput,
    tensorboard_logger,
)
from .checkpoint import checkpoints, load_newest, save_checkpoint, save_evaluations
from .config import Request, TrainConfig, with_overrides
from .export import FILE, ExportError, write_onnx
from .initial import take_over
from .make_env import Actuator, make_single_env, make_vec_env, stream_seed
from .policy_files import policy_of, policy_reward, policy_step, save_for_sb3, save_policy
from .run_folder import RunFolder, chains, check_sources, read_chains, write_chains, write_sources
from .seeds import is_study, learn_all, write_seeds
from .video import record_video

# Each use of randomness has a stream of its own: switching evaluation or film off leaves the training as it is.
_TRAINING, _EVALUATION, _FILM = 0, 1, 2
_VIDEO = "video.mp4"
HARD = {"goal_rate": 0.01, "saturation": 0.25, "heat": 0.25}
"""Means over an episode beyond which a servo does not follow, or soon protects itself; assumed."""


def train(request: Request) -> Path:
    """Start or resume a run, train to its end, and return its folder.

    Raises:
        SealegsError: wrong input, or a full disk.
        Interrupted: the user stopped the run; a checkpoint is saved.
    """
    if request.resume is not None and is_study(request.resume):
        return _train_seeds(request, request.resume)
    if request.resume is not None:
        run = RunFolder.open(request.resume)
        with contextlib.closing(run), _disk_errors(run, request.task):
            config = with_overrides(run.read_config(), request.overrides, str(run.path), request.task, request.trust)
            Session.resumed(run, config, request.trust).learn()
        return run.path
    assert request.config is not None
    session = Session.started(request.config, request.out, request.name, request.seeds)
    run, task = session.run, _own_task(request.config)
    if request.seeds:
        run.close()
        return _train_seeds(replace(request, task=task, trust=True), run.path.parent)  # its code was named just now
    with contextlib.closing(run), _disk_errors(run, task):
        session.learn()
    return run.path


def _train_seeds(request: Request, folder: Path) -> Path:
    """Train the runs of a folder of seeds that are not finished.

    Raises:
        Interrupted: the user stopped; the message says how all of them go on.
    """

    def learn(run: Path) -> None:
        train(replace(request, resume=run, config=None, seeds=()))

    def finished(run: Path) -> bool:
        stored = read_yaml(run / "config.yaml")
        config = with_overrides(stored, request.overrides, str(run), request.task, request.trust)
        step = policy_step(run / "final") or 0
        return step >= config.total_timesteps and not _unfinished(run, config, step)

    try:
        learn_all(folder, learn, finished)
    except Interrupted as stop:
        raise Interrupted(f"{stop}\nThat and the further seeds: {_resume_command(folder, request.task)}") from None
    return folder


class Session:
    """A run folder, its config and its learner in this process."""

    def __init__(self, run: RunFolder, config: TrainConfig, model: BaseAlgorithm, env: BatchVecEnv) -> None:
        self.run, self.config, self.model = run, config, model
        self.env, self.from_step = env, model.num_timesteps
        self._not_exported = ""
        self.chains = chains(env.engine)
        self.description = description_of(config, env)
        evaluate = config.evaluate
        eval_env = make_vec_env(
            config.env, self.chains, min(evaluate.episodes, 8), stream_seed(config.seed, _EVALUATION)
        )
        self.evaluation = Evaluation(
            wrapped(eval_env, config.agent, training=False),
            every=evaluate.every,
            episodes=evaluate.episodes,
            seed=stream_seed(config.seed, _EVALUATION),
            n_envs=config.n_envs,
            folder=str(run.path),
            best=policy_reward(run.path / "best"),  # a killed session may have saved a better one than its checkpoint's
            save_best=self._save_best,
        )

    @classmethod
    def started(cls, config: TrainConfig, out: Path, name: str | None, seeds: Sequence[int] = ()) -> Session:
        """New run, the first of ``seeds`` within a folder of all of them.

        Its folder is created only after environment and learner exist, so wrong input leaves no folder.
        """
        model, env = new_learner(config, config.actuator)
        config = with_fitted(config, env)
        task = str(config.env["id"]).rpartition("/")[2].rpartition(":")[2].partition("-")[0].lower()
        robot = f"{Path(config.env['robot']).stem}-{task}" if "robot" in config.env else task
        actuator = "+".join(dict.fromkeys(chain.label.split()[0] for chain in env.engine.chains.values()))
        run = RunFolder.create(out, f"{robot}-{actuator}-{config.agent['algorithm']}", name)
        if seeds:
            run = RunFolder.create(run.path, "", write_seeds(run.path, seeds))
        with _disk_errors(run, _own_task(config)):
            write_chains(run, env)
            write_sources(run, config.env["id"], env)
            run.write_text("config.yaml", yaml.safe_dump(config.as_dict(), sort_keys=False))
            run.record_session(0)
        return cls(run, config, model, env)

    @classmethod
    def resumed(cls, run: RunFolder, config: TrainConfig, trust: bool = False) -> Session:
        """Run that resumes from its newest complete checkpoint, or from the start if it has none.

        With ``trust``, pickles of earlier versions are read where a checkpoint has nothing else.
        """
        actuator = read_chains(run)
        torch.set_num_threads(config.threads)
        env = make_vec_env(config.env, actuator, config.n_envs, config.seed)
        check_sources(run, config.env["id"], env)
        loaded = load_newest(run, config.agent, env, trust)
        if loaded is None:
            if (run.path / "run.json").is_file():  # a seed that was only laid has not begun before
                print(f"{run.path} has no checkpoint yet: starting from step 0.")
            model, env = new_learner(config, actuator)
            evaluations = None
        else:
            model, evaluations = loaded
            model.set_random_seed(stream_seed(config.seed, _TRAINING, model.num_timesteps))
        if model.num_timesteps >= config.total_timesteps and not _unfinished(run.path, config, model.num_timesteps):
            raise SealegsError(
                f"{run.path} is trained to step {model.num_timesteps} already: give a larger total_timesteps to go on."
            )
        if said := revived(config, model.num_timesteps, int(run.read_config()["total_timesteps"])):
            print(said, flush=True)
        run.write_text("config.yaml", yaml.safe_dump(config.as_dict(), sort_keys=False))
        run.record_session(model.num_timesteps)
        session = cls(run, config, model, env)
        if evaluations is not None:
            session.evaluation.restore(evaluations)
        return session

    def learn(self) -> None:
        """Train up to the configured number of steps; then evaluate, save and film the policy.

        Raises:
            Interrupted: the user stopped the run; a checkpoint is saved.
        """
        project, path = self.config.wandb, self.run.path
        others = () if project is None else (WandbOutput(project, path, self.config.as_dict()),)
        self.model.set_logger(tensorboard_logger(path / "tensorboard", self.from_step, *others))
        with closing(self.model.logger), StopSignals() as signals:
            try:
                if self.from_step < self.config.total_timesteps:
                    self._learn(signals)
                    self.save_checkpoint()  # before anything else can fail: all of the training is in it
                    if signals.asked:
                        raise Interrupted(self._how_to_resume(f"Stopped at step {self.model.num_timesteps}"))
                signals.at_once()
                self._finish()
            except KeyboardInterrupt as stop:
                raise Interrupted(self._how_to_resume("Stopped at once")) from stop
        self._say_where()

    def _learn(self, signals: StopSignals) -> None:
        config = self.config
        start = f" from step {self.from_step}" if self.from_step else ""
        env = str(config.env["id"]) + (f" with robot={config.env['robot']}" if "robot" in config.env else "")
        print(
            f"Training {env}{start} to {config.total_timesteps} on {config.n_envs} simulations, into {self.run.path}",
            flush=True,
        )
        progress = ProgressReport(config.total_timesteps)
        saving = Checkpoints(config.checkpoint.every, self.save_checkpoint)
        own = [callback(item) for item in config.agent.get("callbacks", ())]
        callbacks = CallbackList([StopOnSignal(signals), EpisodeTerms(), self.evaluation, saving, progress, *own])
        remaining = config.total_timesteps - self.from_step
        started = time.monotonic()
        try:
            self.model.learn(remaining, callback=callbacks, reset_num_timesteps=self.from_step == 0)
        finally:
            progress.close()
        seconds, steps = time.monotonic() - started, self.model.num_timesteps - self.from_step
        print(f"Trained {steps} steps in {seconds:.0f} s ({steps / seconds:.0f} steps/s).", flush=True)

    def _finish(self) -> None:
        """The work after the last step; a resumed run makes up for parts that are missing."""
        self.evaluation.evaluate(self.model)
        save_evaluations(self.run, self.model.num_timesteps, self.evaluation.state)
        seen = self.evaluation
        rewards, use, off = seen.rewards(), {"policy": seen.means("servo")}, told_errors(seen)
        reference = seen.of_no_action() if self._corrects() else None
        figures = {"mean_reward": float(rewards.mean())}
        if reference is not None:
            figures["reference_reward"] = float(reference.mean())
            use["reference alone"] = seen.means("servo")
            off = off and f"{off}; its reference alone, {told_errors(seen)}"
        with self.run.writing("final") as folder:
            self._save(folder, self.description | figures)
        print(f"Mean evaluation reward {told(rewards)}.", flush=True)
        if reference is not None:
            print(beside_reference(rewards, reference), flush=True)
        if off:
            print(f"Mean errors of the policy: {off}.", flush=True)
        self._tell_use(use)
        self._film()

    def _tell_use(self, use: dict[str, dict[str, float]]) -> None:
        """Write ``servo.md``: how hard the servos are driven, and the term of what they do not survive."""
        if not use["policy"]:  # its evaluation was made in an earlier session
            return
        weights = self.config.env.get("servo") or {}
        rows = (
            (told, *(f"{column.get(name, math.nan):.3g}" for column in use.values()),
             f"env.servo.{name}: {weights.get(name, 0):g}")
            for name, told in UNITS.items()
        )  # fmt: skip
        text = page("How hard the servos are driven", table(("", *use, "weight of its term"), rows))
        self.run.write_text("servo.md", text)
        hard = [name for name, most in HARD.items() if use["policy"].get(name, 0.0) > most]
        if hard:
            figures = ", ".join(f"{UNITS[name]}: {use['policy'][name]:.2g}" for name in hard)
            print(f"The policy is hard on servos ({figures}): raise env.servo={{{hard[0]}: ...}}, see servo.md.")

    def _corrects(self) -> bool:
        """Whether actions of 0 are a reference, and not the middle of the joints' ranges."""
        engine = self.env.engine
        task, time = engine.task, np.zeros(1)
        command = task.commands(np.full((1, task.draws), 0.5))
        return isinstance(task, ModulatedTask) or task.reference(time, command, engine.numbers) is not None

    def save_checkpoint(self) -> None:
        """Checkpoint of the learner as it is now."""
        save_checkpoint(self.run, self.model, self.description, self.evaluation.state)

    def _save_best(self) -> None:
        with self.run.writing("best") as folder:
            self._save(folder, self.description | {"mean_reward": self.evaluation.last_mean_reward})

    def _save(self, folder: Path, description: dict[str, Any]) -> None:
        save_policy(folder, self.model, description)
        save_for_sb3(folder, self.model)
        self._export(folder)

    def _export(self, folder: Path) -> None:
        """Write ``policy.onnx``, which ``deploy.py`` runs; other kinds of policies are kept all the same."""
        description = read_json(folder / "policy.json")
        try:
            write_onnx(folder / FILE, self.model, description)
        except ExportError as error:
            if str(error) != self._not_exported:  # not again with each best policy
                print(f"No {FILE}: {error}", file=sys.stderr)
            self._not_exported = str(error)

    def _film(self) -> None:
        video = self.config.video
        if video.seconds == 0:
            return
        file = self.run.path / _VIDEO
        seed = stream_seed(self.config.seed, _FILM)
        try:
            env = make_single_env(self.config.env, self.chains, video.width, video.height)
            with contextlib.closing(env), written(file, replace=True) as unfinished:
                record_video(unfinished, policy_of(self.model), env, video.seconds, seed)
        except Exception as error:
            if _disk_full(error):
                raise
            # Drawing needs OpenGL and ffmpeg, which fail in ways of their own. The policy is saved: no reason to fail.
            reason = str(error).strip().partition("\n")[0].rstrip(".") or type(error).__name__
            print(f"No film: {reason}.", file=sys.stderr)

    def _say_where(self) -> None:
        path = self.run.path
        rows = {"Policy": path / "final", "Best policy": path / "best", "Film": path / _VIDEO}
        for label, file in rows.items():
            if file.exists():
                print(f"  {label:<12}{file}")
        print(f"  {'TensorBoard':<12}tensorboard --logdir {path}")

    def _how_to_resume(self, what: str) -> str:
        found = checkpoints(self.run)
        where = f"the checkpoint at step {int(found[0].name)}" if found else "the start (there is no checkpoint yet)"
        return f"{what}; go on from {where} with: {_resume_command(self.run.path, _own_task(self.config))}"


def revived(config: TrainConfig, step: int, before: int) -> str:
    """What a longer training does to values that fall to 0 at its end, as it goes on at ``step``; "": nothing.

    Args:
        config: with the new ``total_timesteps``.
        step: at which it goes on.
        before: ``total_timesteps`` until now.
    """
    falling = {key: start for key, value in config.agent.items() if (start := schedule_start(value)) is not None}
    old, new = (max(1.0 - step / total, 0.0) for total in (before, config.total_timesteps))
    if not falling or new <= old:
        return ""
    values = " and ".join(f"{key} from {old * start:.2g} to {new * start:.2g}" for key, start in falling.items())
    return f"The run is longer now, so what falls to 0 at its end rises again: {values}; agent.<key>= gives others."


def half_interval(rewards: np.ndarray) -> float:
    """Half of the 95 % interval of the mean of rewards (n,), by Student's t; NaN of fewer than two."""
    count = len(rewards)
    return float(student.ppf(0.975, count - 1) * np.std(rewards, ddof=1)) / math.sqrt(count) if count > 1 else math.nan


def told(rewards: np.ndarray) -> str:
    """The mean of rewards (n,) with its 95 % interval."""
    spread = half_interval(rewards)
    return f"{rewards.mean():.4g}" + (f" (+-{spread:.2g}, {len(rewards)} episodes)" if math.isfinite(spread) else "")


def beside_reference(rewards: np.ndarray, reference: np.ndarray) -> str:
    """Whether a policy beats the reference that it corrects, from both their rewards in the same episodes (n,)."""
    gain = rewards - reference
    spread = half_interval(gain)
    known = f"Its reference alone (actions of 0) gets {reference.mean():.4g} in the same episodes"
    if gain.mean() > (spread if math.isfinite(spread) else 0.0):
        return f"{known}; the policy adds {told(gain)}."
    if gain.mean() > 0.0:
        return f"{known}; the policy adds {told(gain)}, which may be chance: more of evaluate.episodes tell."
    return (
        f"{known}: the policy does NOT beat it ({gain.mean():+.3g}). Train longer, with a smaller env.correction, or "
        "use the reference as it is."
    )


def told_errors(seen: Evaluation) -> str:
    """Mean errors of the latest episodes and how many of these failed, in words; empty where the task has none."""
    parts = [f"{name.partition(' [')[0]} {value:.3g} {name.partition(' [')[2].rstrip(']')}"
             for name, value in seen.means("error").items()]  # fmt: skip
    failed = seen.failures()
    return ", ".join(parts) + f"; {failed} episodes end early" * bool(failed) if parts else ""


def new_learner(config: TrainConfig, actuator: Actuator) -> tuple[BaseAlgorithm, BatchVecEnv]:
    """A learner at its start, with the policy of another where the config names one, and its simulations."""
    torch.set_num_threads(config.threads)
    seed = stream_seed(config.seed, _TRAINING)
    env = make_vec_env(config.env, actuator, config.n_envs, seed)
    model = build(config.agent, wrapped(env, config.agent, training=True), seed)
    if config.begun_from is not None:
        take_over(Path(config.begun_from), model, env.engine)
    return model, env


def with_fitted(config: TrainConfig, env: BatchVecEnv) -> TrainConfig:
    """The config with the arguments of its environment that were measured on the model."""
    return replace(config, env={**config.env, **env.engine.fitted}, measured=[*env.engine.fitted])


def _own_task(config: TrainConfig) -> str | None:
    """The task of a run, where it is a file's: whoever resumes the run has to name it again."""
    word = str(config.env["id"])
    return word if is_user_task(word) else None


def _resume_command(run: Path, task: str | None) -> str:
    return f"sealegs train resume={run}" + (f" env={task}" if task else "")


def _unfinished(run: Path, config: TrainConfig, step: int) -> bool:
    """Whether ``final/`` or the film of the policy at ``step`` is missing, as a stop or a full disk leaves a run."""
    final, film = run / "final", run / _VIDEO
    if policy_step(final) != step:
        return True
    # the film follows the policy; one that is older shows what the policy was before the run went on
    return config.video.seconds > 0 and not (film.is_file() and film.stat().st_mtime >= final.stat().st_mtime)


def description_of(config: TrainConfig, env: BatchVecEnv) -> dict[str, Any]:
    """What a policy was learnt in, and the meaning of its inputs and outputs, as ``policy.json`` has them."""
    engine = env.engine
    meaning = {
        "algorithm": config.agent["algorithm"],
        "env": config.env,
        "actuators": chains(engine),
        "wrappers": config.agent.get("wrappers", []),
        "control_rate": 1.0 / engine.dt,
        "observation_names": list(engine.task.observation_names()),
        "action_names": list(engine.action_names),
    }
    if isinstance(engine.task, ModulatedTask):
        return meaning
    return {
        **meaning,
        "goal_at_zero": engine.goal_centre.tolist(),
        "goal_per_action": engine.goal_half.tolist(),
    }


@contextlib.contextmanager
def _disk_errors(run: RunFolder, task: str | None) -> Iterator[None]:
    """Turn a full disk into an error message that says what is saved; ``task`` as of :func:`_own_task`."""
    previous = threading.excepthook

    def silent_if_full(thread_failure: Any) -> None:
        # TensorBoard writes in a thread of its own; its error comes up again in ours, at the next flush.
        if not _disk_full(thread_failure.exc_value):
            previous(thread_failure)

    threading.excepthook = silent_if_full
    try:
        yield
    except OSError as error:
        if not _disk_full(error):
            raise
        found = checkpoints(run)
        safe = f"its checkpoint at step {int(found[0].name)} is complete" if found else "it has no checkpoint yet"
        raise SealegsError(
            f"The disk of {run.path} is full; {safe}. Free some space and go on with: {_resume_command(run.path, task)}"
        ) from error
    finally:
        threading.excepthook = previous


def _disk_full(error: BaseException | None) -> bool:
    return isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
