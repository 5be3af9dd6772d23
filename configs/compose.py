"""Composition of a script's config from its file, the chosen group files and the command line.

Hydra reads the files and the values; the checks stand here because a person who mistypes a key wants one sentence with
the right key in it.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hydra import compose as hydra_compose
from hydra import initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.errors import HydraException
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from ..common import plugins
from ..common.documents import parse_json
from ..common.errors import SealegsError, closest, nearest

FOLDER = Path(__file__).resolve().parent

# What stands for a choice of a group that is no file of the project, such as a robot's own file.
Readers = Mapping[str, Callable[[str], dict[str, Any]]]
# Keys that a config accepts besides those it lists, found from the composed config: they depend on the choices made.
ExtraKeys = Callable[[Mapping[str, Any]], Iterable[str]]


def choices(group: str) -> list[str]:
    """Names that ``group=`` accepts: the files of the folder ``configs/<group>``."""
    return sorted(path.stem for path in (FOLDER / group).glob("*.yaml"))


def groups(script: str) -> list[str]:
    """Choices that the config of ``script`` makes from a folder, in the order of its defaults."""
    config = OmegaConf.load(FOLDER / f"{script}.yaml")
    defaults = config.get("defaults", []) if isinstance(config, DictConfig) else []
    chosen = [str(key) for entry in defaults if isinstance(entry, DictConfig) for key in entry]
    return [key for key in chosen if not key.startswith("optional ")]  # those follow from the others


def split(arguments: Sequence[str], plain: Iterable[str] = (), first: str = "") -> dict[str, str]:
    """Arguments ``key=value`` as a dict; a key given twice keeps the last value, as in Hydra.

    Values of ``plain`` keys are file names or words and are quoted, so that Hydra's grammar leaves them alone.
    ``first`` is the key that a value without one is likely meant for. ``plugins=`` is left out: whoever runs a command
    has loaded them (:func:`sealegs.configs.script.run`).

    Raises:
        SealegsError: an argument has no ``=``.
    """
    pairs: dict[str, str] = {}
    for argument in arguments:
        key, equals, value = argument.partition("=")
        if not equals or not key.strip() or key.startswith("-"):
            meant = f" (did you mean {first}={argument}?)" if first and not equals and argument[:1] != "-" else ""
            raise SealegsError(
                f"'{argument}' is not understood{meant}: arguments have the form key=value (--help lists them)."
            )
        key, value = key.strip(), value.strip()
        if key == plugins.KEY:
            continue
        if key in plain and value not in ("", "null") and value[0] not in "[{'\"":
            value = "'" + value.replace("\\", "\\\\").replace("'", "\\'") + "'"
        pairs[key] = value
    return pairs


def compose(
    script: str, pairs: Mapping[str, str], extra_keys: ExtraKeys | None = None, readers: Readers | None = None
) -> dict[str, Any]:
    """Config of ``script``: ``configs/<script>.yaml`` with its groups, then the values of the command line.

    Args:
        script: name of the script and of its config file.
        pairs: what :func:`split` made of the command line.
        extra_keys: dotted keys that are accepted though no file lists them.
        readers: by group, the config that a user's own file stands for, or a word among a reader's ``names``.

    Raises:
        SealegsError: an unknown key or choice, or a value that cannot be read.
    """
    chosen = {key: _unquoted(value) for key, value in pairs.items() if key in groups(script)}
    names = {group: getattr(reader, "names", ()) for group, reader in (readers or {}).items()}
    own = {group: choice for group, choice in chosen.items() if group in names and _is_path(choice)}
    own |= {group: choice for group, choice in chosen.items() if choice in names.get(group, ())}
    for group, choice in chosen.items():
        if choice not in choices(group) and group not in own:
            known = [*choices(group), *names.get(group, ())]
            raise SealegsError(f"{group}={choice} is not known{nearest(choice, known)}: there are {', '.join(known)}.")
    try:
        with initialize_config_dir(str(FOLDER), version_base="1.3"):
            base = hydra_compose(script, overrides=[f"{key}={word}" for key, word in chosen.items() if key not in own])
    except (HydraException, OmegaConfBaseException) as error:
        raise SealegsError(f"The configs in {FOLDER} do not fit together: {_first_line(error)}") from error
    values = {key: value for key, value in pairs.items() if key not in chosen}
    config = OmegaConf.to_container(base, resolve=False)
    assert isinstance(config, dict)
    for group, choice in own.items():
        config[group] = (readers or {})[group](choice)
        if "${" in json.dumps(config[group], default=str):  # a file is data: no variables of the person's are put in
            raise SealegsError(f"{group}={choice} holds '${{', which stands for nothing here: write the value.")
    return override(config, values, extra_keys)


def _unquoted(value: str) -> str:
    """A choice without the quotes that :func:`split` put around it."""
    return value[1:-1] if value[:1] == value[-1:] == "'" else value


def _is_path(choice: str) -> bool:
    return "." in choice or "/" in choice


def override(base: Any, pairs: Mapping[str, str], extra_keys: ExtraKeys | None = None) -> dict[str, Any]:
    """Copy of the config ``base`` with the values of ``pairs`` put in; keys that ``base`` lacks are refused.

    Raises:
        SealegsError: an unknown key, or a value that cannot be read.
    """
    config = OmegaConf.create(base)
    known, extra = list(_dotted(base)), None
    for key, value in pairs.items():
        if key not in known:
            extra = (
                list(extra_keys(base)) if extra is None and extra_keys else extra or []
            )  # asked late: it may be slow
            if not any(key == name or key.startswith(name + ".") for name in [*extra, *_open(base)]):
                raise SealegsError(
                    f"There is no key '{key}'{_suggestion(key, [*known, *extra])}; --help lists the keys."
                )
        OmegaConf.update(config, key, _parse(key, value), merge=False, force_add=True)
    try:
        resolved = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    except OmegaConfBaseException as error:
        raise SealegsError(f"A value of the config cannot be resolved: {_first_line(error)}") from error
    assert isinstance(resolved, dict)
    return {str(key): value for key, value in resolved.items()}


def _parse(key: str, value: str) -> Any:
    """Value of one argument, read with Hydra's grammar, or as JSON: its keys may be any names and patterns of names."""
    if value.startswith(("{", "[")):
        with contextlib.suppress(ValueError):
            return parse_json(value)
    try:
        parsed: Override = OverridesParser.create().parse_override(f"{key}={value}")
        found, sweep = parsed.value(), parsed.is_sweep_override()
    except (HydraException, ValueError, RecursionError) as error:  # such as of a number of 5000 digits
        raise SealegsError(
            f"{key}={value} cannot be read: put a value with spaces or special characters in quotes, {key}='\"...\"'."
        ) from error
    if sweep:
        raise SealegsError(f"{key}={value} is a sweep: give one value; a list is written [a,b].")
    return found


def _dotted(config: Any, prefix: str = "") -> Iterable[str]:
    """All keys of nested mappings, joined by dots; inner nodes too."""
    for key, value in config.items() if isinstance(config, Mapping) else ():
        yield f"{prefix}{key}"
        yield from _dotted(value, f"{prefix}{key}.")


def _open(config: Any, prefix: str = "") -> Iterable[str]:
    """Keys whose value is an empty mapping: anything may be put below them."""
    for key, value in config.items() if isinstance(config, Mapping) else ():
        if isinstance(value, Mapping):
            yield from _open(value, f"{prefix}{key}.") if value else (f"{prefix}{key}",)


OTHER_COMMANDS_SAY = {"seconds": "duration", "duration": "seconds"}
"""Of what a key of another command is called in this one."""


def _suggestion(key: str, known: list[str]) -> str:
    """Hint at the key that was meant: one of the same last word in another place comes first.

    Below a prefix that there is, only its own keys are meant.
    """
    prefix, dot, word = key.rpartition(".")
    below = {name[len(prefix) + 1 :]: name for name in known if name.startswith(prefix + dot)} if dot else {}
    if below:
        same = next((name for rest, name in below.items() if rest.rpartition(".")[2] == word), None)
        meant = same or below.get(closest(word, below) or "")
        return f" (did you mean '{meant}'?)" if meant else ""
    words_of_it = (word, OTHER_COMMANDS_SAY.get(word))
    same_word = [name for name in known if name.rpartition(".")[2] in words_of_it]
    if same_word:
        return f" (did you mean '{same_word[0]}'?)"
    hint = nearest(key, known)
    if hint:
        return hint
    words = {name.rpartition(".")[2]: name for name in known}
    for candidate, name in words.items():
        if nearest(word, [candidate]):
            return f" (did you mean '{name}'?)"
    return ""


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
