"""The fenced code blocks of README and docs: found, and run as a reader would, in a folder of their own."""

from __future__ import annotations

import contextlib
import importlib.util
import re
import shlex
import shutil
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from sealegs import cli
from sealegs.commands import new_robot
from sealegs.configs.compose import compose, split

REPOSITORY = Path(__file__).resolve().parents[1]
FENCE = re.compile(r'^( *)```(\w*)(?: title="([^"]+)")?\n(.*?)^ *```$', re.MULTILINE | re.DOTALL)
SHOWN = {"text", "csv", "json"}
"""Languages of blocks that nobody types."""

COMPOSED_ONLY = {
    "calibrate": "a hand moves the joints",
    "virtual": "serves until Ctrl-C",
    "loop": "tests/test_sim_to_real.py runs it",
    "scan": "tests/test_virtual_bus.py runs it",
    "evaluate": "tests/test_sim_to_real.py and those of the papers run it",
    "watch": "tests/test_watch.py runs it",
    "characterize": "tests/test_brake_bench.py runs it",
    "train-net": "tests/test_actuator_net.py runs it",
    "demo": "make demo runs it",
}
"""Commands whose arguments are checked here and which are run elsewhere."""
ANY_FILE = {"robot": lambda _: compose("deploy", {})["robot"], "env": lambda _: compose("train", {})["env"]}
"""What a robot or a task of the reader's own is taken for where a command is only checked."""
SMALLER = {
    "train": "total_timesteps=256 n_envs=2 evaluate.every=0 video.seconds=0",
    "deploy": "hw.virtual.time=stepped hw.timeout=1 silence=20 live=false duration=2",
}
"""What is added to a command, so that its page runs in seconds."""
RESUMED = "total_timesteps=512 evaluate.every=0 video.seconds=0"
"""What is added to a training that goes on: it keeps its settings, and ended already on this page."""
HARDWARE = ("hw=feetech", "hw=dynamixel")
"""A command with one of them is run on the virtual bus instead: the words that need a real port are taken away."""
ABSENT = ("../shared/data", "logs/fleet", "logs/xl330", "logs/ak80", "logs/so101", "logs/servo", "bench.csv", "/tmp/")
"""What a reader has and a test has not: such commands are checked, not run."""
ELSEWHERE = {
    "next_experiment.csv": "tests/test_next_experiment.py and test_sim_to_real.py run one",
    "log=logs/hopper": "tests/test_contact_causes.py diagnoses a hopper",
    "env=hexapod": "tests/test_hexapod.py trains it",
    "env=biped": "tests/test_biped.py trains it",
    "reference=true": "tests/test_deploy.py runs it",
    "hexapod.onnx": "tests/test_gait_export.py exports and runs it",
}
"""Parts of commands that other tests run."""


@dataclass(frozen=True)
class Block:
    """One fenced block: where it stands, its language, its title, its text."""

    page: str
    line: int
    language: str
    title: str
    text: str

    @property
    def commands(self) -> list[str]:
        """Lines of a shell block, without comments."""
        whole = self.text.replace("\\\n", " ")
        lines = (shlex.join(shlex.split(line, comments=True)) for line in whole.splitlines())
        return [line for line in lines if line]


def pages() -> list[Path]:
    """README, and the pages that a person wrote or that are made from the code."""
    return [REPOSITORY / "README.md", *sorted((REPOSITORY / "docs").rglob("*.md"))]


def blocks(path: Path) -> list[Block]:
    """The fenced blocks of a page, in order."""
    text = path.read_text(encoding="utf-8")
    found = []
    for match in FENCE.finditer(text):
        indent, language, title, body = match.groups()
        body = "".join(line.removeprefix(indent) for line in body.splitlines(keepends=True))
        line = text.count("\n", 0, match.start()) + 1
        found.append(Block(str(path.relative_to(REPOSITORY)), line, language, title or "", body))
    return found


def check(block: Block) -> None:
    """What can be said of a block without running it.

    Raises:
        AssertionError: a language that nothing is done with, or a text that is not in the file it is said to be of.
        Exception: bad YAML or Python; a command or key that there is none of.
    """
    if block.language == "yaml":
        yaml.safe_load(block.text)
    elif block.language == "xml":
        ElementTree.fromstring(block.text)
    elif block.language == "python":
        compile(block.text, f"{block.page}:{block.line}", "exec")
        if (source := REPOSITORY / block.title).is_file():
            assert block.text in source.read_text(encoding="utf-8"), f"{block.title} does not have this text any more"
    elif block.language == "sh":
        for command in block.commands:
            check_command(shlex.split(command))
    else:
        assert block.language in SHOWN, (
            f"a block of language '{block.language}': sh, python, yaml, xml, text, csv or json"
        )


def check_command(words: list[str]) -> None:
    """Whether there is such a command and it takes these arguments."""
    match words:
        case ["make", target]:
            assert re.search(rf"^{target}:", (REPOSITORY / "Makefile").read_text(), re.MULTILINE), f"no make {target}"
        case ["pip", "install", *_] | ["source", *_] | ["sealegs", "--help"]:
            pass
        case ["python", "-m", module, *_]:
            assert importlib.util.find_spec(module), f"no module {module}"
        case ["sealegs", "evaluate", "relevant", *arguments]:
            compose("relevant", split(arguments, plain=()))
        case ["sealegs", word, *arguments]:
            assert word in cli.COMMANDS, f"no command {word}"
            if word == "import":
                arguments = [f"source={arguments[0]}", *arguments[1:]]
            if word == "new-robot":
                assert {item.partition("=")[0] for item in arguments[1:]} <= set(new_robot.KEYS)
                return
            if not cli.COMMANDS[word][1]:  # its arguments are files
                return
            compose(cli.COMMANDS[word][1], split(arguments, plain=()), readers=ANY_FILE)
        case _:
            raise AssertionError(f"'{' '.join(words)}' is of no kind that is checked")


@dataclass
class Reader:
    """Somebody who types what a page says, from top to bottom, in a folder of their own."""

    folder: Path
    names: dict[str, Any] = field(default_factory=dict)
    skipped: list[str] = field(default_factory=list)

    def do(self, block: Block) -> None:
        """Type one block."""
        if block.language in ("yaml", "xml") and block.title:
            path = self.folder / block.title
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text)
        elif block.language == "python" and not (REPOSITORY / (block.title or "?")).is_file():
            if "/dev/ttyUSB0" not in block.text:
                exec(compile(block.text, f"{block.page}:{block.line}", "exec"), self.names)
        elif block.language == "sh":
            for command in block.commands:
                self.run(shlex.split(command))

    def run(self, words: list[str]) -> None:
        """Type one command; what cannot be run here is noted."""
        command = " ".join(words)
        if words[0] != "sealegs" or words[1] in COMPOSED_ONLY or any(name in command for name in (*ABSENT, *ELSEWHERE)):
            self.skipped.append(command)
            return
        word, arguments = words[1], words[2:]
        if any(item in HARDWARE for item in arguments):
            real = (*HARDWARE, "port=", "dead_man")
            arguments = [item for item in arguments if not item.startswith(real)]
        given = {item.partition("=")[0] for item in arguments}
        smaller = RESUMED if "resume" in given else SMALLER.get(word, "")
        arguments += [item for item in smaller.split() if item.partition("=")[0] not in given]
        for item in arguments:  # what another page has made already
            key, _, value = item.partition("=")
            target = self.folder / ("runs" if key == "name" else "") / value
            if (key, word) in (("out", "diagnose"), ("name", "train")) and target.exists():
                shutil.rmtree(target)
        assert cli.main([word, *arguments]) == 0, command


@contextlib.contextmanager
def world(folder: Path, made: Mapping[str, Path]) -> Iterator[Reader]:
    """A reader in ``folder``, who has done already what is ``made``: folders by the path that pages call them."""
    for name, source in made.items():
        shutil.copytree(source, folder / name)
    with contextlib.chdir(folder):
        yield Reader(folder)
