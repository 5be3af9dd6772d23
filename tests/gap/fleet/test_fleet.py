"""A fleet: several servos side by side, some of them broken, stopped and resumed, and a table over all of them."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import sys
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path

import pytest
from sealegs.common.errors import SealegsError
from sealegs.gap.fleet import Job, Outcome, diagnose_fleet, find_jobs, rows_of, shared_causes, write_table
from sealegs.gap.fleet import jobs as jobs_module
from sealegs.gap.fleet.jobs import finished, fits_of_joint, joints_of, run_job, source
from sealegs.gap.fleet.page import draw_fleet, write_page
from sealegs.gap.fleet.run import in_processes, shipped, written_log
from sealegs.gap.load.robot import robot_of
from sealegs.gap.log import read_measured, write_run
from sealegs.gap.output.partial import source_of
from sealegs.gap.search.journal import Journal

from testbed import hidden_bench
from testbed.logs import hidden_arm
from tests.typed import diagnose_command


def document(name: str, cause: str | None, value: float = 0.0) -> dict:
    parameters = {
        f"{cause}.x": {"value": value, "low": value - 0.01, "high": value + 0.01, "unit": "1", "nominal": 0.0}
    }
    causes = [] if cause is None else [
        {"name": cause, "joint": "servo", "kind": "effect", "share": 0.9, "confidence": 0.95, "parameters": parameters}
    ]  # fmt: skip
    gap = {key: {"rmse": 0.01, "mae": 0.008} for key in ("nominal", "refitted", "extended", "noise_floor")}
    verdict = "explained" if cause else "nothing to explain"
    return {"joint": "servo", "verdict": verdict, "sentence": f"{name}: {verdict}.", "gap": gap, "causes": causes}


OUTCOMES = [
    Outcome("left", document("left", "friction.load_dependent", 0.10)),
    Outcome("right", document("right", "friction.load_dependent", 0.105)),
    Outcome("hip", document("hip", "friction.load_dependent", 0.30)),
    Outcome("knee", document("knee", "drive.delay", 0.02)),
    Outcome("ankle", document("ankle", None)),
    Outcome("broken", error="logs/broken: the column 'time' is missing."),
]


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    """Folders of three servos; one of them has a broken log, and one folder holds none."""
    for k, name in enumerate(("a", "b")):
        data, _ = hidden_bench({}, k, duration=1.0, runs=1)
        for one in data.runs:
            write_run(one, tmp_path / "fleet" / name)
    (tmp_path / "fleet" / "c").mkdir()
    (tmp_path / "fleet" / "c" / "run.csv").write_text("time,servo.position\n0,1\n")
    (tmp_path / "fleet" / "notes").mkdir()
    return tmp_path / "fleet"


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """Diagnoses that take no time, in this process; the list says which folders were diagnosed."""
    done: list[str] = []

    def diagnosed(log: Path, out: Path, progress: object = None, **settings: object) -> None:
        if log.name in ("c", "notes"):
            raise SealegsError(f"{log}: its {'sidecar is' if log.name == 'c' else 'logs are'} missing.")
        done.append(log.name)
        out.mkdir(parents=True, exist_ok=True)
        (out / "diagnosis.json").write_text(json.dumps(document(log.name, "drive.delay", 0.01)))

    def here(jobs: list[Job], workers: int, report: object) -> Iterator[Outcome]:
        yield from map(run_job, jobs)

    monkeypatch.setattr(jobs_module, "diagnose_folder", diagnosed)
    monkeypatch.setattr("sealegs.gap.fleet.run.in_processes", here)
    yield done


def test_every_folder_is_a_servo_where_one_has_a_log(fleet: Path, tmp_path: Path) -> None:
    """One that is empty was dropped without a word."""
    assert [job.name for job in find_jobs(fleet, tmp_path / "out")] == ["a", "b", "c", "notes"]
    assert [job.name for job in find_jobs(fleet, fleet / "c")] == ["a", "b", "notes"], "what is written is no log"
    with pytest.raises(SealegsError, match="a folder of logs for each servo"):
        find_jobs(fleet / "a", tmp_path / "out")


def test_a_broken_folder_does_not_stop_the_others(
    fleet: Path, tmp_path: Path, quick: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert diagnose_command(f"log={fleet}", f"out={out}", "fleet=true") == 0
    assert quick == ["a", "b"]
    assert sorted(path.name for path in out.iterdir()) == ["a", "b", "fleet.csv", "fleet.html", "fleet.png"]
    table = list(csv.DictReader((out / "fleet.csv").open()))
    said = {row["servo"]: row["verdict"] for row in table}
    assert said == {"a": "explained", "b": "explained", "c": "not diagnosed", "notes": "not diagnosed"}
    assert "its sidecar is missing" in table[-2]["sentence"]
    assert "its sidecar is missing" in (out / "fleet.html").read_text()
    assert "drive.delay: 2 servos" in capsys.readouterr().out


def test_what_is_finished_is_kept_and_the_rest_is_done(fleet: Path, tmp_path: Path, quick: list[str]) -> None:
    out = tmp_path / "out"
    first = find_jobs(fleet, out)[0]
    assert run_job(first).document is not None
    before = (out / "a" / "diagnosis.json").stat().st_mtime_ns
    outcomes = {o.name: o for o in diagnose_fleet(find_jobs(fleet, out))}
    assert quick == ["a", "b"]
    assert outcomes["a"].kept and not outcomes["b"].kept
    assert (out / "a" / "diagnosis.json").stat().st_mtime_ns == before


def test_a_diagnosis_of_other_logs_or_settings_is_never_overwritten(
    fleet: Path, tmp_path: Path, quick: list[str]
) -> None:
    out = tmp_path / "out"
    assert run_job(find_jobs(fleet, out)[0]).document is not None
    other = find_jobs(fleet, out, {"seed": 3})[0]
    with pytest.raises(SealegsError, match="not overwritten"):
        finished(other)
    (fleet / "a" / "further.csv").write_text("time\n")
    outcomes = {o.name: o for o in diagnose_fleet(find_jobs(fleet, out))}
    assert "not overwritten" in outcomes["a"].error and outcomes["b"].document is not None


def test_nothing_unfinished_stays(fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stopped(log: Path, out: Path, progress: object = None, **settings: object) -> None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "half").write_text("")
        raise KeyboardInterrupt

    monkeypatch.setattr(jobs_module, "diagnose_folder", stopped)
    with pytest.raises(KeyboardInterrupt):
        run_job(find_jobs(fleet, tmp_path / "out")[0])
    assert list((tmp_path / "out").iterdir()) == []


def test_ctrl_c_says_how_to_go_on(
    fleet: Path, tmp_path: Path, quick: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(jobs: list[Job], workers: int, report: object) -> Iterator[Outcome]:
        yield run_job(jobs[0])
        raise KeyboardInterrupt

    monkeypatch.setattr("sealegs.gap.fleet.run.in_processes", interrupted)
    assert diagnose_command(f"log={fleet}", f"out={tmp_path / 'out'}", "fleet=true") == 130
    assert "1 of 4 servos are kept" in capsys.readouterr().err
    assert (tmp_path / "out" / "a" / "diagnosis.json").is_file()


@pytest.mark.long
def test_processes_of_their_own_diagnose_and_one_that_dies_takes_no_other_along(fleet: Path, tmp_path: Path) -> None:
    jobs = find_jobs(fleet, tmp_path / "out")
    lost = Job("lost", fleet / "absent", tmp_path / "out" / "lost")
    outcomes = {o.name: o for o in diagnose_fleet([lost, jobs[2]], workers=2)}
    assert "no such file" in outcomes["lost"].error
    assert "sidecar" in outcomes["c"].error


def dies(job: Job, connection: Connection, joints: int) -> None:
    """Body of a process that dies, the first time or always."""
    mark = job.log.with_suffix(".seen")
    if job.name == "always" or not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    connection.send(Outcome(job.name, document(job.name, None)))


@pytest.mark.long
def test_a_servo_whose_process_dies_is_begun_once_more(tmp_path: Path) -> None:
    jobs = [Job(name, tmp_path / name, tmp_path / "out" / name) for name in ("once", "always")]
    told: list[tuple[str, str]] = []
    outcomes = {o.name: o for o in in_processes(jobs, 2, lambda name, text: told.append((name, text)), dies)}
    assert outcomes["once"].document is not None and "SIGKILL" in outcomes["always"].error
    assert sum(text == "starting" for _, text in told) == 4 and any("Once more" in text for _, text in told)


def test_ray_is_named_where_it_is_missing(
    fleet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    assert diagnose_command(f"log={fleet}", f"out={tmp_path / 'out'}", "fleet=ray") == 2
    said = capsys.readouterr().err
    assert "pip install 'sealegs[fleet]'" in said and "fleet=true" in said and len(said.splitlines()) == 1


@pytest.mark.parametrize(
    ("argument", "hint"),
    [
        ("fleet=yes please", "fleet="),
        ("workers=0", "workers="),
        ("limits=[1,-1]", "limits="),
        ("speed_limit=-2", "speed"),
    ],
)
def test_wrong_words_get_one_sentence(
    argument: str, hint: str, fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert diagnose_command(f"log={fleet}", argument) == 2
    said = capsys.readouterr().err.strip()
    assert hint in said and len(said.splitlines()) == 1


def test_the_table_says_who_shares_a_cause_and_how_its_values_spread() -> None:
    rows = rows_of(OUTCOMES)
    assert [row.servo for row in rows] == ["ankle", "broken", "hip", "knee", "left", "right"]
    load, delay = shared_causes(rows)
    assert load.name == "friction.load_dependent" and load.servos == ("hip", "left", "right")
    assert load.middle == pytest.approx(0.105) and load.spread == pytest.approx(0.114, abs=0.002)
    assert not load.common and "differ by more than their intervals" in load.sentence
    assert delay.servos == ("knee",) and "knee alone" in delay.sentence
    alike = shared_causes(rows_of([OUTCOMES[0], OUTCOMES[1]]))[0]
    assert alike.common and "one value fits all" in alike.sentence


@pytest.mark.parametrize("value", [0.21, 0.1, 11.0])
def test_a_number_without_a_unit_keeps_its_digits(value: float) -> None:
    (cause,) = shared_causes(rows_of([Outcome("knee", document("knee", "drive.delay", value))]))
    assert cause.sentence == f"drive.delay: knee alone, drive.delay.x = {value:g}."


def test_the_csv_has_a_line_per_servo_and_parameter(tmp_path: Path) -> None:
    write_table(rows_of(OUTCOMES), tmp_path / "fleet.csv")
    lines = list(csv.DictReader((tmp_path / "fleet.csv").open()))
    assert len(lines) == len(OUTCOMES)
    assert next(line for line in lines if line["servo"] == "knee")["value"] == "0.02"
    assert next(line for line in lines if line["servo"] == "broken")["sentence"].endswith("'time' is missing.")


def test_the_page_holds_all_it_shows(tmp_path: Path) -> None:
    rows = rows_of(OUTCOMES)
    written = write_page(rows, shared_causes(rows), tmp_path, "robot")
    html = written["page"].read_text()
    assert 'src="data:image/png;base64,' in html and "http" not in html
    assert all(row.servo in html for row in rows)
    assert len(draw_fleet(rows, shared_causes(rows)).axes) == 3
    empty = rows_of([OUTCOMES[4]])
    assert "No cause" in write_page(empty, shared_causes(empty), tmp_path, "robot")["page"].read_text()


def test_a_fleet_on_ray_gives_the_same(fleet: Path, tmp_path: Path) -> None:
    from sealegs.gap.fleet.run import diagnosed_elsewhere, received

    job = find_jobs(fleet, tmp_path / "out")[2]
    error, files = diagnosed_elsewhere(job.name, {path.name: path.read_bytes() for path in job.log.iterdir()}, {})
    assert "sidecar" in error and not files
    content = {
        "diagnosis.json": json.dumps(document("c", None)).encode(),
        "source.json": json.dumps(source(job)).encode(),
    }
    (tmp_path / "out").mkdir()
    assert received(job, {**content, "pictures/budget.png": b"x"}).document is not None
    assert (tmp_path / "out" / "c" / "pictures" / "budget.png").read_bytes() == b"x"


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs of a two-link arm with friction in its elbow, beside its model."""
    folder = tmp_path_factory.mktemp("arm")
    data, _ = hidden_arm(folder, "two_link", {"friction": ("elbow", "clear")}, 3, runs=1, duration=6.0)
    for one in data.runs:
        write_run(replace(one, robot=Path(one.robot).name), folder)
    return folder


@pytest.mark.weekly
def test_fits_of_joints_that_were_made_elsewhere_are_not_made_again(
    arm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = {"causes": ["friction.coulomb"]}
    assert list(joints_of(arm)) == ["shoulder", "elbow"] and not joints_of(tmp_path / "nowhere")
    fits = b"".join(fits_of_joint(arm, joint, settings) for joint in joints_of(arm))
    made: list[str] = []
    record = Journal.record

    def noted(self: Journal, question: str, answer: dict) -> None:
        made.append(question)
        record(self, question, answer)

    monkeypatch.setattr(Journal, "record", noted)
    with_fits = run_job(Job("arm", arm, tmp_path / "with", settings), fits=fits)
    shared, made[:] = len(made), []
    without = run_job(Job("arm", arm, tmp_path / "without", settings))
    assert shared <= len(made) - fits.count(b"\n") < len(made)
    assert with_fits.document is not None and without.document is not None
    assert with_fits.document["joints"] == without.document["joints"]


@pytest.mark.long
def test_a_robot_on_ray_has_a_task_for_each_joint(arm: Path, tmp_path: Path) -> None:
    ray = pytest.importorskip("ray", reason="the extra fleet is not installed")
    settings = {"causes": ["friction.coulomb"]}
    job = Job("arm", arm, tmp_path / "on_ray", settings)
    said: list[str] = []
    (outcome,) = diagnose_fleet([job], cluster=True, report=lambda name, text: said.append(text))
    assert not ray.is_initialized() and outcome.document is not None, outcome.error
    here = run_job(Job("arm", arm, tmp_path / "here", settings))
    assert here.document is not None and here.document["joints"] == outcome.document["joints"]


def test_a_corrected_sidecar_is_not_taken_for_what_was_diagnosed(fleet: Path, tmp_path: Path, quick: list[str]) -> None:
    out = tmp_path / "out"
    out.mkdir()
    list(diagnose_fleet(find_jobs(fleet, out)))
    sidecar = next((fleet / "a").glob("*.yaml"))
    text = sidecar.read_text()
    sidecar.write_text(text.replace("mass: 0.5", "mass: 0.6"))
    assert len(sidecar.read_text()) == len(text) and sidecar.read_text() != text
    again = {outcome.name: outcome for outcome in diagnose_fleet(find_jobs(fleet, out))}
    assert "not what" in again["a"].error and again["b"].kept


def test_a_robot_that_was_edited_since_is_not_taken_for_what_was_diagnosed(
    fleet: Path, tmp_path: Path, quick: list[str]
) -> None:
    """The diagnosis of the old model was kept: its file lay beside the folder of the log."""
    for sidecar in (fleet / "a").glob("*.yaml"):
        sidecar.write_text(sidecar.read_text().replace("robot: bench", "robot: ../arm.xml"))
    (fleet / "arm.xml").write_text('<mujoco><include file="parts.xml"/></mujoco>')
    (fleet / "parts.xml").write_text("<mujocoinclude/>")
    job = find_jobs(fleet, tmp_path / "out")[0]
    run_job(job)
    assert finished(job) is not None
    (fleet / "parts.xml").write_text('<mujocoinclude><option gravity="0 0 0"/></mujocoinclude>')
    with pytest.raises(SealegsError, match="its robot or its settings are not what"):
        finished(job)


def test_a_robot_beside_the_folder_of_its_log_goes_to_the_worker_too(arm: Path, tmp_path: Path) -> None:
    log = tmp_path / "logs" / "arm"
    shutil.copytree(arm, log)
    name = Path(read_measured(arm).runs[0].robot).name
    shutil.move(log / name, tmp_path / name)
    for sidecar in log.glob("*.yaml"):
        sidecar.write_text(sidecar.read_text().replace(f"robot: {name}", f"robot: ../../{name}"))
    (tmp_path / "worker").mkdir()
    there = written_log(tmp_path / "worker", "arm", shipped(log))
    assert there.parents[2] == (tmp_path / "worker" / "logs").resolve()
    run = read_measured(there).runs[0]
    assert Path(run.robot).is_relative_to(tmp_path / "worker") and robot_of(run) is not None
    assert source_of(there, {}) == source_of(log, {})


def test_values_belong_to_the_servos_that_have_them() -> None:
    def with_causes(name: str, *parameters: str) -> Outcome:
        whole = document(name, "sensor.scale", 0.5)
        (cause,) = whole["causes"]
        value = next(iter(cause["parameters"].values()))
        whole["causes"] = [{**cause, "parameters": {path: value}} for path in parameters]
        return Outcome(name, whole)

    outcomes = [
        with_causes("b", "host.scale"),
        with_causes("c", "encoder.scale", "current"),
        with_causes("d", "encoder.scale"),
    ]
    (cause,) = shared_causes(rows_of(outcomes))
    assert cause.servos == ("b", "c", "d")
    assert cause.parameter == "encoder.scale" and set(cause.values) == {"c", "d"}


@pytest.mark.parametrize(("unit", "text"), [("rad", "10 → 10 mrad"), ("N.m", "0.01 → 0.01 N.m"), ("1", "0.01 → 0.01")])
def test_errors_have_their_unit(unit: str, text: str) -> None:
    whole = document("knee", None)
    whole["gap"]["unit"] = unit
    (row,) = rows_of([Outcome("knee", whole)])
    assert row.errors == text
