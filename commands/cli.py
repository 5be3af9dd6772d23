"""The command ``sealegs``, with one subcommand for each job; the scripts of a checkout do the same."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.metadata import version

from ..common.errors import nearest
from ..configs.script import BAD_INPUT, load, run

COMMANDS = {
    "train": ("sealegs.commands.train", "train", "learn a policy"),
    "sweep": ("sealegs.commands.sweep", "sweep", "search for the values that a training does best with"),
    "diagnose": ("sealegs.commands.diagnose", "diagnose", "explain a gap from measured logs"),
    "deploy": ("sealegs.commands.deploy", "deploy", "run a policy or an excitation on servos, real or virtual"),
    "evaluate": ("sealegs.commands.evaluate", "evaluate", "compare models, machine and published figures"),
    "loop": ("sealegs.commands.loop", "loop", "measure, diagnose, extend, train, deploy and compare"),
    "watch": ("sealegs.commands.watch", "watch", "film a policy"),
    "characterize": ("sealegs.commands.characterize", "characterize", "fit a servo's torque from a brake bench"),
    "train-net": ("sealegs.commands.train_net", "train_net", "train an actuator net from logs"),
    "scan": ("sealegs.hw.machine.scan", "scan", "list the servos on a bus"),
    "calibrate": ("sealegs.hw.machine.calibration", "calibrate", "measure zero, direction and range of each joint"),
    "virtual": ("sealegs.hw.virtual.__main__", "virtual", "serve a virtual bus of servos"),
    "new-robot": ("sealegs.commands.new_robot", "", "write the YAML of a robot from its MJCF or URDF"),
    "export": ("sealegs.agents.export", "", "write a trained policy as ONNX"),
    "hub": ("sealegs.agents.hub", "", "share runs by the Hugging Face hub, without pickles"),
    "repair-log": ("sealegs.hw.run.measured_log", "", "copy a log without the line that a power cut tore"),
    "import": ("sealegs.commands.import_log", "import", "turn recordings of other formats into measured logs"),
    "transfer": ("sealegs.commands.transfer", "transfer", "measure whether training on a diagnosed model pays"),
    "demo": ("sealegs.commands.demo", "demo", "measure, diagnose, extend and train once, without hardware"),
}
"""By subcommand: module with ``main(arguments)``, name of its config file (empty: its arguments are files), purpose."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit status: 0, 2 for wrong input, 130 for Ctrl-C, 70 for a bug."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if len(words) > 1 and words[0] == "help":
        words = [*words[1:], "--help"]
    if not words or words[0] in ("-h", "--help", "help"):
        width = max(map(len, COMMANDS))
        print("Usage: sealegs <command> key=value ...    sealegs <command> --help\n")
        print("\n".join(f"  {word:{width}s}  {text}" for word, (_, _, text) in COMMANDS.items()))
        return 0 if words else BAD_INPUT
    if words[0] in ("--version", "-V"):
        print(f"sealegs {version('sealegs')}")
        return 0
    word, *rest = words
    if word not in COMMANDS:
        known = ", ".join(COMMANDS)
        print(f"There is no command '{word}'{nearest(word, COMMANDS)}; there are {known}.", file=sys.stderr)
        return BAD_INPUT
    module_name, config, _ = COMMANDS[word]
    module = load(module_name, config or word)
    if isinstance(module, int):
        return module
    asks = bool({"-h", "--help"} & set(rest))
    if asks and not config:
        print((module.__doc__ or "").strip())
        return 0
    try:
        return run(module.main, config, module.__doc__ or "", rest)
    except SystemExit as end:  # of a parser of its own
        return end.code if isinstance(end.code, int) else BAD_INPUT
