"""The code blocks of README and docs: found, and run as a reader would, with the machines that they name."""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest.mock import patch

import yaml
from sealegs.agents.config import extra_keys
from sealegs.commands import cli, new_robot
from sealegs.configs.compose import compose, split
from sealegs.hw.bus import servo_bus as servo_bus
from sealegs.hw.machine import calibration
from sealegs.hw.machine.own_robot import READERS
from sealegs.hw.virtual import VirtualBus

DYNAMIXEL = {
    "model": "xl330_m288",
    "actuator": "xl330",
    "servos": {"joint": {"id": 2}},
    "registers": {"baud_rate": 3},  # 1 Mbit/s, set with the manufacturer's tool
}
MOVES = ((0.0,), (0.5,), (-0.8, 0.8))
"""What a calibration of the bench asks for: hanging, to its positive side, from stop to stop [rad]."""
PASSING = 0.1  # [s] of a stepped bus that nobody asks
SERVER = "import sys; from sealegs.commands.cli import main; sys.exit(main())"


class PatientBus(servo_bus.ServoBus):
    """A bus on a busy computer, with at most two servos; the latest one opened is the hand's."""

    opened: Any = None

    def __init__(self, port: str, *arguments: Any, **keys: Any) -> None:
        super().__init__(port, *arguments, **{**keys, "timeout": 1.0})
        PatientBus.opened = self

    def scan(self, ids: Iterable[int] = range(3)) -> dict[int, int]:
        """The others are known to be absent, and would cost time."""
        return super().scan(ids)


@dataclass
class Machines:
    """What stands on the reader's desk; a bus is started where a command names its port, and lives as long as the page.

    Attributes:
        folder: of the reader.
        stack: of all that must be ended.
    """

    folder: Path
    stack: contextlib.ExitStack
    buses: dict[str, VirtualBus] = field(default_factory=dict)

    def serve(self, arguments: list[str]) -> None:
        """``sealegs virtual``: serves until Ctrl-C, which comes where the page ends."""
        command = [sys.executable, "-c", SERVER, "virtual", *arguments, "time=stepped"]
        server = self.stack.enter_context(
            subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=self.folder, start_new_session=True)
        )
        assert server.stdout is not None and server.stdout.readline().startswith("port: ")
        self.stack.callback(_interrupted, server)

    def done(self, word: str, arguments: list[str]) -> int:
        """Exit status of a command, with a bus on the port that it names."""
        if PORT not in arguments:
            return cli.main([word, *arguments])
        virtual = self._bus("xl330" if any("xl330" in item for item in arguments) else "sts3215")
        arguments = [f"port={virtual.port}" if item == PORT else item for item in arguments]
        if word == "scan":
            with passing(virtual):
                return cli.main([word, *arguments])
        if word != "calibrate":
            return cli.main([word, *arguments])
        moves = [*MOVES]

        def moved(question: str) -> str:
            bus = PatientBus.opened
            (servo,) = bus.scan()
            for angle in moves.pop(0):
                bus.torque_on([servo])
                bus.write_goals([servo], [angle])
                virtual.advance(1.0)
            return ""

        guide = functools.partial(calibration.guide, ask=moved)
        with patch.object(servo_bus, "ServoBus", PatientBus), patch.object(calibration, "guide", guide):
            return cli.main([word, *arguments])

    def _bus(self, servo: str) -> VirtualBus:
        if servo not in self.buses:
            keys: dict[str, Any] = DYNAMIXEL if servo == "xl330" else {}
            self.buses[servo] = self.stack.enter_context(VirtualBus(time="stepped", cycle=0.0, **keys))
        return self.buses[servo]


@contextlib.contextmanager
def passing(virtual: VirtualBus) -> Iterator[None]:
    """Time passes on a stepped bus while nobody asks it: a servo that restarts is silent for a while."""
    ended = threading.Event()

    def steps() -> None:
        while not ended.wait(PASSING):
            virtual.advance(PASSING)

    thread = threading.Thread(target=steps)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _interrupted(server: subprocess.Popen[str]) -> None:
    server.send_signal(signal.SIGINT)
    assert server.wait(10.0) == 130


@contextlib.contextmanager
def machines(folder: Path) -> Iterator[Machines]:
    """An empty desk; whatever is put on it is ended with the block."""
    with contextlib.ExitStack() as stack:
        yield Machines(folder, stack)


REPOSITORY = Path(__file__).resolve().parents[1]
FENCE = re.compile(r'^( *)```(\w*)(?: title="([^"]+)")?\n(.*?)^ *```$', re.MULTILINE | re.DOTALL)
SHOWN = {"text", "csv", "json"}
"""Languages of blocks that nobody types."""


class AnyRobot:
    """A robot of the reader's own, or of ours that files alone describe, where a command is only checked."""

    names = READERS["robot"].names

    def __call__(self, word: str) -> dict[str, Any]:
        return compose("deploy", {})["robot"]


ANY_FILE = {"robot": AnyRobot(), "env": lambda _: compose("train", {})["env"]}
"""What a robot or a task of the reader's own is taken for where a command is only checked."""
STEPPED = "hw.virtual.time=stepped hw.timeout=1 silence=20 live=false robot.safety.late=5 robot.safety.silent=1"
SMALLER = {
    "train": "total_timesteps=256 n_envs=2 evaluate.every=0 evaluate.episodes=1 video.seconds=0",
    "deploy": f"{STEPPED} duration=2",
    "diagnose": "causes=[friction.coulomb,drive.delay]",
    "evaluate": f"{STEPPED} seconds=2",
    "evaluate relevant": "seconds=0.5 tempos=[1]",
    "watch": "seconds=0.1 width=64 height=48",
    "train-net": "epochs=1",
    "scan": "last=3",
    "loop": "hw.timeout=1 silence=20 excitations=[hold] loads=[{mass:0.25,length:0.1}] further=0 total_timesteps=256 "
    "seconds=2",
}
"""What is added to a command, so that its page runs in seconds."""
RESUMED = "total_timesteps=512 evaluate.every=0 video.seconds=0"
"""What is added to a training that goes on: it keeps its settings, and ended already on this page."""
HARDWARE = ("hw=feetech", "hw=dynamixel")
"""A command with one of them is run on the virtual bus instead: the words that need a real port are taken away."""
PORT, FIXED_PORT = "port=/dev/ttyUSB0", "/tmp/servos"
"""An adapter of the reader's, for which a virtual bus stands in; and the port that a page serves itself."""
SHARED_DATA, NO_DATA = "../shared/data", "needs the published data"
NOT_RUN = {
    "make ": "installs, takes hours, or is this test itself",
    "pip install": "installs packages",
    "source .venv": "is of the reader's shell",
    "python -m docs.generate": "writes into the checkout: test_docs compares the pages",
    "python -m sealegs.actuators": "writes into the checkout: test_chain compares the page",
    "python -m benchmarks": "takes minutes to days; only its --help is run",
    "fleet=true": "compiles again in its workers: tests/gap/fleet/test_fleet.py diagnoses one",
    "train env=hexapod": "takes a minute: tests/envs/test_hexapod.py trains it",
    "paper=": "takes up to minutes a robot: tests/papers",
    "sealegs loop\n": "train-and-deploy.md runs it",
    "sealegs sweep": "trains dozens of times: tests/agents/test_sweep.py sweeps",
    "sealegs hub": "needs an account: tests/agents/test_hub.py serves a hub",
    "plugins=": "would stay in this process: tests/actuators/test_plugins.py runs it",
    "log=logs/servo": "its run is cut to 2 s here, too short to diagnose: logs/bench is diagnosed",
    "log=logs/xl330": "takes minutes of published data: benchmarks/real_data.py",
    "log=logs/ak80": "takes minutes of published data: benchmarks/real_data.py",
    "log=logs/hopper": "takes minutes: tests/gap/ground/test_ground.py diagnoses a hopper",
}
"""Why a command with this in it is checked but not run."""


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
        case ["sealegs", "sweep", *arguments]:
            if importlib.util.find_spec("optuna"):  # an extra of its own
                from sealegs.agents.sweep import read_sweep

                read_sweep(arguments)
        case ["sealegs", word, *arguments]:
            assert word in cli.COMMANDS, f"no command {word}"
            if word == "import":
                arguments = [f"source={arguments[0]}", *arguments[1:]]
            if word == "new-robot":
                assert {item.partition("=")[0] for item in arguments[1:]} <= set(new_robot.KEYS)
                return
            if not cli.COMMANDS[word][1]:  # its arguments are files
                return
            extra = extra_keys if word == "train" else None
            compose(cli.COMMANDS[word][1], split(arguments, plain=()), extra, readers=ANY_FILE)
        case _:
            raise AssertionError(f"'{' '.join(words)}' is of no kind that is checked")


def why_not(command: str) -> str | None:
    """Why a command is not run here; None: it is."""
    if command.endswith("--help"):
        return None
    if SHARED_DATA in command and not (REPOSITORY / SHARED_DATA).is_dir():
        return NO_DATA
    return next((why for part, why in NOT_RUN.items() if part in f"{command}\n"), None)


@dataclass
class Reader:
    """Somebody who types what a page says, from top to bottom, in a folder of their own."""

    folder: Path
    machines: Machines
    names: dict[str, Any] = field(default_factory=dict)
    skipped: list[str] = field(default_factory=list)

    def do(self, block: Block) -> None:
        """Type one block."""
        own = block.language == "python" and not (REPOSITORY / block.title).is_file()
        if block.title and (own or block.language in ("yaml", "xml", "csv")):
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
        if why_not(command) is not None:
            self.skipped.append(command)
        elif words[0] == "python":
            subprocess.run([sys.executable, *words[1:]], cwd=REPOSITORY, check=True, capture_output=True, timeout=120)
        elif words[1] == "virtual":
            if "hidden=hidden.yaml" in words and not (self.folder / "hidden.yaml").exists():
                (self.folder / "hidden.yaml").write_text("friction.coulomb: 0.1\n")  # which the page shows later
            self.machines.serve(self._here(words[2:]))
        else:
            word, arguments = words[1], self._here(words[2:])
            arguments = self._fresh(word, arguments)
            assert self.machines.done(word, arguments) == 0, command

    def _here(self, arguments: list[str]) -> list[str]:
        """Arguments with this machine's paths and ports for those of the reader."""
        found = [item.replace(FIXED_PORT, str(self.folder / "servos")) for item in arguments]
        found = [item.replace(SHARED_DATA, str(REPOSITORY / SHARED_DATA)) for item in found]
        if any(item in HARDWARE for item in found) and PORT in found:
            return [item for item in found if not item.startswith((*HARDWARE, "port=", "dead_man"))]
        return found

    def _fresh(self, word: str, arguments: list[str]) -> list[str]:
        """Arguments with what makes them short; what another page has made already is out of the way."""
        given = {item.partition("=")[0] for item in arguments}
        kind = "evaluate relevant" if word == "evaluate" and "relevant" in arguments else word
        smaller = RESUMED if "resume" in given else SMALLER.get(kind, "")
        if any(item in HARDWARE for item in arguments):  # on a port that the page serves
            smaller = smaller.replace("hw.virtual.time=stepped ", "")
        arguments = arguments + [item for item in smaller.split() if item.partition("=")[0] not in given]
        for item in arguments:
            key, _, value = item.partition("=")
            target = self.folder / ("runs" if key == "name" else "") / value
            if (key, word) in (("out", "diagnose"), ("name", "train")) and target.exists():
                shutil.rmtree(target)
            if (key, word) == ("excitation", "deploy") and value.endswith(".csv") and not target.exists():
                target.write_text("time,joint.goal\n0,0\n1,0.2\n2,0\n")  # nothing was left to be proposed here
        return arguments


@contextlib.contextmanager
def world(folder: Path, made: Mapping[str, Path]) -> Iterator[Reader]:
    """A reader in ``folder``, who has done already what is ``made``: files and folders by the path that pages call
    them. Beside them lie the policies of the checkout.
    """
    for name, source in made.items():
        if source.is_dir():
            shutil.copytree(source, folder / name)
        else:
            shutil.copy(source, folder / name)
    if not (folder / "policies").exists():
        (folder / "policies").symlink_to(REPOSITORY / "policies")
    with contextlib.chdir(folder), machines(folder) as servos:
        yield Reader(folder, servos)
