"""A config value is taken in the type of its parameter, or refused in one sentence with the key in it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from annotated_types import Gt
from sealegs.commands import demo, diagnose, loop, watch
from sealegs.common.errors import SealegsError
from sealegs.configs.check import Count, Natural, Pixels, Positive, Share, arguments, checked, checked_seed, or_null
from sealegs.configs.script import run

INFINITE, NO_NUMBER = float("inf"), float("nan")


class Learner:
    """A class that no YAML file can hold."""


@pytest.mark.parametrize(
    ("value", "kind", "taken"),
    [
        (5, float, 5.0),
        (1e6, int, 1_000_000),
        (True, bool, True),
        ("abc", str, "abc"),
        (None, float | None, None),
        (3, str | int | None, 3),
        (1.0, float | int, 1.0),
        (1.0, int | float, 1),
        ([0, 1], float | Sequence[float], [0.0, 1.0]),
        ([1, 2], tuple[float, ...], (1.0, 2.0)),
        ([1, "step"], int | tuple[int, str], (1, "step")),
        ([1, 2], tuple, (1, 2)),
        ([{"delay": {}}], list[Any] | dict[str, Any] | str | None, [{"delay": {}}]),
        ({"a": [1]}, dict[str, Any], {"a": [1]}),
        ({"a": 1}, Mapping[str, float], {"a": 1}),
        ("hold", Literal["release", "hold"], "hold"),
        (1, Any, 1),
        (1, Count, 1),
        (0, Natural, 0),
        (None, or_null(Positive), None),
    ],
)
def test_a_value_is_taken_in_the_type_of_its_parameter(value: Any, kind: Any, taken: Any) -> None:
    result = checked("key", value, kind)
    assert result == taken and type(result) is type(taken)


@pytest.mark.parametrize(
    ("value", "kind", "sentence"),
    [
        ("abc", int, "key takes a whole number, not 'abc'."),
        (1.5, int, "key takes a whole number, not 1.5."),
        (True, int, "key takes a whole number, not True."),
        (INFINITE, int, "key takes a whole number, not inf."),
        (None, int, "key takes a whole number, not None."),
        (True, float, "key takes a number, not True."),
        ("5", float, "key takes a number, not '5'."),
        (NO_NUMBER, float, "key takes a number, not nan."),
        (INFINITE, float | None, "key takes a number or null, not inf."),
        ("abc", float | None, "key takes a number or null, not 'abc'."),
        (1, bool, "key takes true or false, not 1."),
        (1, str, "key takes a word, not 1."),
        ("ab", Sequence[float], "key takes a list, not 'ab'."),
        (["a"], list[int], "key takes a list, not ['a']."),
        ("ab", dict | bool, "key takes a mapping or true or false, not 'ab'."),
        ("go", Literal["release", "hold"], "key takes 'release' or 'hold', not 'go'."),
        ("x", float | Callable[[float], float], "key takes a number or a schedule such as lin_3e-4, not 'x'."),
        (0, Count, "key must be at least 1, not 0."),
        (0, or_null(Count), "key must be at least 1, not 0."),
        (-1, Natural, "key must be at least 0, not -1."),
        (8, Pixels, "key must be at least 16, not 8."),
        (0, Positive, "key must be more than 0, not 0."),
        (1.5, Share, "key must be less than 1, not 1.5."),
        (2, Annotated[float, Gt(2.5)], "key must be more than 2.5, not 2."),
        ("x", or_null(Count), "key takes a whole number or null, not 'x'."),
    ],
)
def test_another_value_is_refused_in_one_sentence(value: Any, kind: Any, sentence: str) -> None:
    with pytest.raises(SealegsError) as refusal:
        checked("key", value, kind)
    assert str(refusal.value) == sentence


def test_a_caller_may_say_it_in_words_of_its_own() -> None:
    with pytest.raises(SealegsError, match="give two angles"):
        checked("limits", [1], tuple[float, float], "give two angles")


def test_a_seed_is_a_whole_number_from_0() -> None:
    assert checked_seed(3) == 3
    with pytest.raises(SealegsError, match="seed must be at least 0, not -3"):
        checked_seed(-3)


def test_arguments_that_no_file_can_hold_are_left_out() -> None:
    def build(size: int, learner: Learner, both: Learner | str, rate: float = 1.0, *rest: int, **more: int) -> None: ...

    assert arguments(build, {"rate"}) == {"size": int, "both": Learner | str}
    with pytest.raises(SealegsError, match="both takes an object or a word, not 3"):
        checked("both", 3, Learner | str)


@pytest.mark.parametrize(
    ("command", "argument", "sentence"),
    [
        ("diagnose", "seed=-1", "seed=-1 must be a whole number from 0."),
        ("diagnose", "seed=1.5", "seed=1.5 must be a whole number from 0."),
        ("diagnose", "workers=0", "workers=0 must be a whole number from 1."),
        ("diagnose", "fleet=no", "fleet=no must be true (this machine), ray (a Ray cluster) or false."),
        ("diagnose", "limits=1", "limits=1 must be two angles [rad], the lower one first"),
        ("diagnose", "limits=[1,-1]", "limits=[1, -1] must be two angles [rad], the lower one first"),
        ("diagnose", "causes=friction.colomb", "no cause 'friction.colomb' (did you mean 'friction.coulomb'?)"),
        ("diagnose", "causes=[friction.colomb]", "no cause 'friction.colomb' (did you mean 'friction.coulomb'?)"),
        ("diagnose", "speed_limit=0", "speed_limit=0 must be a speed above zero [rad/s]."),
        ("watch", "width=8", "width must be at least 16, not 8."),
        ("watch", "duration=3", "There is no key 'duration' (did you mean 'seconds'?)"),
        ("demo", "total_timesteps=0", "total_timesteps must be at least 1, not 0."),
    ],
)
def test_a_command_refuses_a_wrong_value(
    command: str, argument: str, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main = {"diagnose": diagnose.main, "watch": watch.main, "demo": demo.main}[command]
    needed = {"diagnose": ["log=logs/none"], "watch": ["policy=policies/none"], "demo": []}[command]
    assert run(main, command, "", [*needed, argument]) == 2
    assert sentence in capsys.readouterr().err


def test_the_loop_is_for_one_servo(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "loop"
    assert run(loop.main, "loop", "", ["robot=hopper", f"out={out}"]) == 2
    assert "robot=hopper has the joints hip, knee" in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("loads=3", "loads=3 must be a list of numbers of the robot"),
        ("loads=[{mas:0.3}]", "has no parameter 'mas'"),
        ("excitations=chirp", "excitations=chirp must be a list of names"),
        ("excitations=[chrip]", "there is no excitation 'chrip' (did you mean 'chirp'?)"),
        ("excitations=[]", "nothing would be measured"),
        ("further=two", "further takes a whole number"),
        ("reach=-1", "reach=-1 must be a number above 0"),
        ("stepped=soon", "stepped takes true or false"),
        ("hidden=much", "hidden=much must be a mapping"),
    ],
)
def test_the_loop_refuses_a_wrong_value_before_anything_moves(
    wrong: str, said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """``loads=3`` ended in a TypeError, ``excitations=chirp`` in letters, ``further=two`` after the measurement."""
    out = tmp_path / "loop"
    assert run(loop.main, "loop", "", [wrong, f"out={out}"]) == 2
    told = capsys.readouterr().err
    assert said in " ".join(told.split()) and "Traceback" not in told and not out.exists()
