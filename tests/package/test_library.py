"""The library: a diagnosis from a path, from arrays and from data frames, kept, saved and looked at in a notebook."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from html.parser import HTMLParser
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import sealegs
from sealegs.agents.make_env import checked_env
from sealegs.commands import new_robot
from sealegs.commands.cli import main
from sealegs.common.errors import SealegsError
from sealegs.gap.log.reader import measured_set
from sealegs.gap.search import journal

from testbed import hidden_bench
from tests.small_diagnosis import small_diagnosis

SIDECAR = {"robot": "bench", "robot_params": {"mass": 0.5, "length": 0.12}, "actuators": {"servo": "sts3215"}}
TIME = np.arange(200) * 0.01
COLUMNS = {"time": TIME, "servo.goal": np.sin(TIME), "servo.position": np.sin(TIME)}


@pytest.fixture(scope="module")
def diagnosis() -> sealegs.Diagnosis:
    found, data = small_diagnosis()
    return sealegs.Diagnosis(data.name, tuple(run.name for run in data.runs), (found,), data)


def test_importing_the_library_loads_nothing_heavy() -> None:
    heavy = ["torch", "numba", "matplotlib", "scipy", "pandas"]
    code = f"import sealegs, sys; print([name for name in {heavy} if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"
    shown = {name for name in dir(sealegs) if not name.startswith("__")}
    assert shown == set(sealegs.__all__) and "__version__" in dir(sealegs)
    assert sealegs.__version__ == version("sealegs")


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda folder: sealegs.load_robot(None), "a robot is a name or the path of its file, not None"),  # pyright: ignore[reportArgumentType]
        (lambda folder: sealegs.make_env("bench", num_envs="4"), "num_envs is '4'; it must be a whole number"),  # pyright: ignore[reportArgumentType]
        (lambda folder: sealegs.make_env(None), "an environment is a name such as 'hopper'"),  # pyright: ignore[reportArgumentType]
        (lambda folder: sealegs.diagnose(COLUMNS, sidecar="bench"), "sidecar='bench' is no sidecar; give a dict"),  # pyright: ignore[reportArgumentType]
        (lambda folder: sealegs.diagnose(folder / "leg.yaml"), "holds no measurements; give the measured log"),
        (lambda folder: new_robot.main([str(folder)]), "is a folder; name the model in it"),
        (
            lambda folder: checked_env({"id": "SeaLegs/Bench-v0", "robot": "leg.yaml"}),
            "env=track, env=reach and env=walk take any: sealegs train env=track robot=leg.yaml",
        ),
    ],
)
def test_what_is_mistaken_for_something_else_is_told_in_a_sentence(
    call: Callable[[Path], object], says: str, tmp_path: Path
) -> None:
    (tmp_path / "leg.yaml").write_text("model: leg.xml\n")
    with pytest.raises(SealegsError) as refusal:
        call(tmp_path)
    assert says in str(refusal.value)


def test_help_is_a_word_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["help"]) == 0
    assert "sealegs <command>" in (whole := capsys.readouterr().out)
    assert main(["--help"]) == 0 and capsys.readouterr().out == whole
    assert main(["help", "scan"]) == 0 and "port=/dev/ttyUSB0" in capsys.readouterr().out


def test_arrays_and_a_data_frame_are_the_same_run() -> None:
    one = measured_set(COLUMNS, SIDECAR)
    two = measured_set([pd.DataFrame(COLUMNS), pd.DataFrame(COLUMNS)], [SIDECAR, SIDECAR])
    assert one.runs[0].columns().keys() == two.runs[1].columns().keys() == COLUMNS.keys()
    for name, values in COLUMNS.items():
        np.testing.assert_array_equal(two.runs[0].columns()[name], values)
    assert one.runs[0].actuators == {"servo": "sts3215"} and one.runs[0].source is None


@pytest.mark.parametrize(
    "columns, sidecar, said",
    [
        (COLUMNS, None, "has no sidecar"),
        (COLUMNS, {**SIDECAR, "robots": "x"}, "unknown key 'robots'"),
        (COLUMNS, [SIDECAR, SIDECAR], "1 runs and 2 sidecars"),
        ({**COLUMNS, "servo.goal": TIME[:-1]}, SIDECAR, "equally long"),
        ({**COLUMNS, "servo.goal": ["x"] * 200}, SIDECAR, "no numbers"),
        ({**COLUMNS, "servo.gaol": TIME}, SIDECAR, "unknown column 'servo.gaol'"),
        ({"servo.position": TIME}, SIDECAR, "'time'"),
        ([], SIDECAR, "no run"),
        ([7], SIDECAR, "is int"),
    ],
)
def test_columns_that_are_no_log_are_refused_in_one_sentence(columns: object, sidecar: object, said: str) -> None:
    with pytest.raises(SealegsError) as refused:
        sealegs.diagnose(columns, sidecar=sidecar)  # pyright: ignore[reportArgumentType]  (wrong on purpose)
    assert said in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize("wrong", [{"seed": -1}, {"limits": [1.0]}, {"speed_limit": 0.0}, {"causes": ["drive.dealy"]}])
def test_settings_that_cannot_be_are_refused(wrong: dict, tmp_path: Path) -> None:
    with pytest.raises(SealegsError):
        sealegs.diagnose(COLUMNS, sidecar=SIDECAR, keep=tmp_path / "out", **wrong)


def test_a_joint_that_the_log_does_not_drive_is_named_with_those_that_it_drives() -> None:
    said = r"^The log drives no joint 'serov' \(did you mean 'servo'\?\); joints= takes servo\.$"
    with pytest.raises(SealegsError, match=said):
        sealegs.diagnose(COLUMNS, sidecar=SIDECAR, joints=["serov"])


@pytest.mark.long
def test_a_diagnosis_is_read_back_as_it_was_saved_and_is_never_overwritten(
    diagnosis: sealegs.Diagnosis, tmp_path: Path
) -> None:
    written = diagnosis.save(tmp_path / "out")
    assert all(path.exists() for path in written.values())
    again = sealegs.Diagnosis.load(tmp_path / "out")
    assert (again.verdict, again.sentence, again.runs) == (diagnosis.verdict, diagnosis.sentence, diagnosis.runs)
    assert again.causes[0].parameters == diagnosis.causes[0].parameters
    assert again.joint("servo").gap == diagnosis.joint("servo").gap
    assert again.extended.changes[0].after == pytest.approx(diagnosis.extended.changes[0].after, rel=1e-5)
    assert json.loads((tmp_path / "out" / "diagnosis.json").read_text()) == again.to_dict()
    with pytest.raises(SealegsError, match="nothing in it is overwritten"):
        diagnosis.save(tmp_path / "out")
    with pytest.raises(SealegsError, match="holds no diagnosis"):
        sealegs.Diagnosis.load(tmp_path)


class Reader(HTMLParser):
    """Checks that tags nest, and keeps the text."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.text: list[str] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        del attrs
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def test_a_notebook_shows_a_diagnosis_in_a_few_lines_of_html(diagnosis: sealegs.Diagnosis) -> None:
    reader = Reader()
    reader.feed(diagnosis._repr_html_())
    reader.close()
    assert not reader.open
    assert diagnosis.sentence in "".join(reader.text)
    assert "friction.load_dependent" in reader.text
    assert len(diagnosis._repr_html_()) < 5000 and len(repr(diagnosis)) < 200


@pytest.mark.long
def test_a_diagnosis_that_was_stopped_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data, _ = hidden_bench({"drive.delay": "clear"}, seed=2, duration=4.0, runs=2)
    made: list[int] = []
    close = journal.Journal.close
    monkeypatch.setattr(journal.Journal, "close", lambda self: (made.append(self.made), close(self))[1])

    def stop(text: str) -> None:
        if text.startswith("found"):
            raise KeyboardInterrupt

    out, causes = tmp_path / "out", ("drive.delay", "friction.viscous")
    with pytest.raises(KeyboardInterrupt):
        sealegs.diagnose(data, causes=causes, keep=out, progress=stop)
    told = json.loads((out / "partial" / "partial.json").read_text())
    assert told["said"][-1]["text"].startswith("found drive.delay")
    with (out / "partial" / "fits.jsonl").open("a") as file:
        file.write('{"key": "torn')  # as a kill leaves it
    with pytest.raises(SealegsError, match="unfinished diagnosis of other logs or settings"):
        sealegs.diagnose(data, causes=causes, keep=out, seed=5)
    whole = sealegs.diagnose(data, causes=causes, keep=tmp_path / "whole")
    resumed = sealegs.diagnose(data, causes=causes, keep=out)
    before, straight, after = made
    assert before > 0 and after == straight - before
    assert resumed.to_dict() == whole.to_dict()
    resumed.save(out)
    assert not (out / "partial").exists()
