"""Run folders to and from the Hugging Face hub, without pickles.

    sealegs hub upload runs/first me/hopper         the policies of a run: numbers, graphs, configs
    sealegs hub download me/hopper runs/theirs      as a run folder that watch, evaluate, deploy and export read

Uploaded are safetensors, ONNX, YAML and JSON, and nothing else: no pickle of Stable-Baselines3, and no file that tells
of your machine (run.json, sources.json). Checkpoints stay here. A repository is made private; the hub's page opens it.
Downloaded are the same kinds alone, whatever else the repository holds. Log in once by `hf auth login`.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..common.atomic import folder_written
from ..common.errors import SealegsError, nearest
from ..common.extras import needed_for
from .policy_files import policy_step
from .seeds import runs_of

KINDS = (".safetensors", ".onnx", ".yaml", ".json")
PRIVATE = ("run.json", "sources.json")
"""Files with paths and packages of the machine that a run was made on."""


def shared_files(folder: Path) -> list[Path]:
    """Files of a run, or of a folder of seeds, that may leave this machine, relative to it.

    Raises:
        SealegsError: there is no policy in it.
    """
    runs = [run for run in (folder, *runs_of(folder)) if (run / "config.yaml").is_file()]
    if not any(policy_step(run / kind) is not None for run in runs for kind in ("final", "best")):
        raise SealegsError(f"{folder} is no run with a policy: give one, such as runs/first.")
    within = [path for run in {folder, *runs} for part in (run, run / "best", run / "final") for path in part.glob("*")]
    return sorted(
        path.relative_to(folder)
        for path in set(within)
        if path.is_file() and path.suffix in KINDS and path.name not in PRIVATE and not path.name.startswith(".")
    )


def upload(folder: Path, repository: str) -> str:
    """Write the shared files of a run into a repository; where it is.

    Raises:
        SealegsError: there is no policy in the folder, or the hub refuses.
    """
    files = shared_files(folder)
    with needed_for("The hub"):
        from huggingface_hub import HfApi
    with _told(repository):
        api = HfApi()
        api.create_repo(repository, private=True, exist_ok=True)
        api.upload_folder(
            repo_id=repository, folder_path=folder, allow_patterns=[path.as_posix() for path in files],
            commit_message=f"sealegs run {folder.resolve().name}",
        )  # fmt: skip
    return f"{api.endpoint}/{repository}"


def download(repository: str, folder: Path) -> Path:
    """Write the run of a repository into a new folder.

    Raises:
        SealegsError: the folder exists, the hub refuses, or the repository holds no policy.
    """
    if folder.exists():
        raise SealegsError(f"{folder} exists, and a run is never overwritten: give another folder.")
    with needed_for("The hub"):
        from huggingface_hub import snapshot_download
    folder.parent.mkdir(parents=True, exist_ok=True)
    with folder_written(folder) as unfinished:
        with _told(repository):
            snapshot_download(repository, local_dir=unfinished, allow_patterns=[f"*{kind}" for kind in KINDS])
        shutil.rmtree(unfinished / ".cache", ignore_errors=True)  # of the library
        if not any(unfinished.rglob("policy.json")):
            raise SealegsError(f"{repository} holds no policy of sealegs.")
    return folder


@contextmanager
def _told(repository: str) -> Iterator[None]:
    """Turn what the hub, or the way to it, answers into a sentence."""
    from huggingface_hub import errors

    try:
        yield
    except (errors.HfHubHTTPError, errors.HFValidationError, errors.LocalTokenNotFoundError, OSError) as error:
        reason = error
    except Exception as error:
        if not type(error).__module__.startswith("httpx"):  # the library's client, whose name has changed
            raise
        reason = error
    else:
        return
    said = str(reason).strip().partition("\n")[0].rstrip(".") or type(reason).__name__
    raise SealegsError(f"The hub does not give or take {repository}: {said}.")


def main(arguments: list[str]) -> None:
    """Do what the command line asks for."""
    words = {"upload": "upload <run> <owner/name>", "download": "download <owner/name> <folder>"}
    if len(arguments) != 3 or arguments[0] not in words:
        meant = nearest(arguments[0], words) if arguments else ""
        raise SealegsError(f"say sealegs hub {' or sealegs hub '.join(words.values())}{meant}.")
    if arguments[0] == "upload":
        folder = Path(arguments[1])
        print(f"Uploaded: {', '.join(map(str, shared_files(folder)))}\nto {upload(folder, arguments[2])}")
    else:
        print(f"Downloaded: {download(arguments[1], Path(arguments[2]))}")
