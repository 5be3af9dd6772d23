"""What the supervisor's process does once its loop is gone: it never gives up, never keeps quiet, forgets no servo."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from sealegs.common.alarm import Alarm
from sealegs.hw.bus.packets import PortBusyError, PortError
from sealegs.hw.bus.servo_bus import ServoBus
from sealegs.hw.guard.hold_watch import HoldWatch, InCharge
from sealegs.hw.guard.supervision import End, watch
from sealegs.hw.guard.supervisor import (
    ASKING,
    BEAT,
    DONE,
    HELD,
    READY,
    RELEASE,
    RESTING,
    STARTING,
    Bearable,
    Charge,
    Line,
)
from sealegs.hw.guard.take_over import Aftermath, bring_all_to_rest

from tests.simulated_runs import Simulation

GONE = PortError("there is no port /dev/ttyUSB0; plug the adapter in, or give its name as port=<path>.")
BUSY = PortBusyError("another program has /dev/ttyUSB0; stop it, or give another port.")
WHY = "the loop ended without bringing the servos to rest"


class Left:
    """Four servos with torque whose loop is gone, and what a supervisor notes and says, all in simulated time.

    Attributes:
        said, noted: lines and events.
        opening: with what error the port answers when it is asked for, by how often it was; None: it opens.
        opened: how often the port was asked for.
    """

    def __init__(self, opening: Callable[[int], Exception | None] = lambda count: None, lasting: bool = True) -> None:
        self.simulation = Simulation("row")
        self.simulation.bus.torque_on([1, 2, 3, 4])
        self.said, self.noted, self.opened = list[str](), list[dict[str, Any]](), 0
        self.opening, self.asked, self.alone, self.pressed = opening, 0, True, False
        self.after = Aftermath(
            note=lambda kind, **details: self.noted.append({"event": kind, **details}),
            say=self.said.append,
            clock=self.simulation.port,
            alone=lambda: self.alone,
            asked=lambda: self.asked,
            pid=4711,
            lasting=lasting,
            pressed=lambda: self.pressed,
        )
        self.lines = [Line("", self.open, [1, 2, 3, 4])]
        self.watcher: HoldWatch | None = None

    def open(self) -> ServoBus:
        self.opened += 1
        if (error := self.opening(self.opened)) is not None:
            raise error
        return ServoBus("simulated", opened=self.simulation.port.reopened(), timeout=0.02)

    def release(self, rest: Any = "release") -> str | None:
        return bring_all_to_rest(self.lines, rest, self.after, WHY)

    @property
    def now(self) -> float:
        return self.simulation.port.now()


# --- taking over -------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_servos_that_cannot_be_reached_are_said_at_the_first_failure_and_never_given_up() -> None:
    begun: list[float] = []
    left = Left(lambda count: GONE if left.now - begun[0] < 12.0 else None)
    begun.append(left.now)
    at: list[float] = []
    say = left.said.append
    left.after = Aftermath(**{**vars(left.after), "say": lambda line: (at.append(left.now), say(line))})
    assert left.release() and left.simulation.torque == [False] * 4
    assert left.said[0].startswith("TORQUE MAY BE ON at servo(s) 1, 2, 3, 4: CUT THE POWER.") and at[0] == begun[0]
    assert "there is no port" in left.said[0] and "`kill 4711`" in left.said[0] and len(left.said) == 2
    assert left.said[1].startswith(f"The{WHY[3:]}; the supervisor has released servo(s) 1, 2, 3, 4 after 12 s")
    assert [event["event"] for event in left.noted] == ["not at rest", "at rest"]
    assert left.opened < 800, "it is in no hurry for ever"


def test_a_release_that_succeeds_is_said_too_where_nobody_else_does() -> None:
    left = Left()
    assert left.release() and len(left.said) == 1 and "has released servo(s) 1, 2, 3, 4" in left.said[0]
    waiting = Left()
    waiting.alone = False  # the loop reports it
    assert waiting.release() and waiting.said == []


def test_a_person_ends_the_tries_and_reads_that_torque_may_be_on() -> None:
    left = Left(lambda count: GONE)
    left.alone = False
    left.opening = lambda count: (setattr(left, "asked", int(count > 5)), GONE)[1]
    assert not left.release()
    assert left.said == [left.said[-1]] and left.said[-1].startswith("TORQUE MAY BE ON at servo(s) 1, 2, 3, 4")
    assert left.noted[-1]["servos"] == ["1", "2", "3", "4"]


def test_an_error_that_nobody_foresaw_does_not_end_the_tries() -> None:
    faults = [FileNotFoundError(2, "No such file", "sts3215.yaml"), ZeroDivisionError("a bug"), None]
    left = Left(lambda count: faults[min(count, 3) - 1])
    assert left.release() and left.simulation.torque == [False] * 4
    assert "FileNotFoundError" in left.said[0]


def test_no_servo_waits_for_those_of_another_bus_that_are_silent() -> None:
    silent, fine = Left(), Left()
    silent.simulation.fault("silence", seconds=0.5)
    lines = [Line("", silent.open, [1, 2, 3, 4]), Line("legs", fine.open, [1, 2, 3, 4])]
    begun = silent.now
    fine.simulation.port.clock.time = begun
    assert bring_all_to_rest(lines, "release", silent.after, WHY)
    off = [time for time, _, on in fine.simulation.rig.history if not on]
    assert max(off) - begun < 0.02, "on its own clock: nothing was waited for"
    assert "servo(s) 1, 2, 3, 4: CUT" in silent.said[0] and silent.simulation.torque == [False] * 4


def test_a_virtual_machine_that_has_ended_is_not_waited_for() -> None:
    left = Left(lambda count: GONE, lasting=False)
    assert not left.release() and left.said == [] and left.opened == 1


def test_an_emergency_stop_has_servos_released_that_could_not_be_held() -> None:
    left = Left()
    left.simulation.fault("silence", servos=[2], seconds=0.5)
    left.pressed = True
    assert left.release("hold") == "release" and left.simulation.torque == [False] * 4
    left = Left()
    left.simulation.fault("silence", servos=[2], seconds=0.5)
    say = left.said.append
    left.after = replace(left.after, say=lambda line: (setattr(left, "pressed", True), say(line))[1])
    assert left.release("hold") == "release", "pressed after the others were held"
    assert left.simulation.torque == [False] * 4 and "released" in left.said[-1]


def test_servos_that_are_known_to_be_released_are_not_named() -> None:
    left = Left()
    left.simulation.fault("silence", servos=[2])
    left.opening = lambda count: GONE if count > 2 else None
    left.asked = 0
    left.after = replace(left.after, asked=lambda: int(left.opened > 4))
    assert left.release() is None and left.simulation.torque == [False, True, False, False]
    assert all("servo(s) 2: CUT THE POWER" in line for line in left.said), left.said
    assert [event["servos"] for event in left.noted if event["event"] == "not at rest"] == [["2"], ["2"]]


def test_what_the_loop_has_released_is_not_named_by_the_supervisor() -> None:
    left = Left(lambda count: GONE)
    left.after = replace(left.after, asked=lambda: int(left.opened > 2))
    assert bring_all_to_rest(left.lines, "release", left.after, WHY, on=("3",)) is None
    assert all("servo(s) 3: CUT THE POWER" in line for line in left.said) and left.noted[-1]["servos"] == ["3"]
    gone, other = Left(lambda count: GONE), Left()
    lines = [Line("", gone.open, [1, 2, 3, 4]), Line("legs", other.open, [1, 2, 3, 4])]
    assert bring_all_to_rest(lines, "release", gone.after, WHY, on=("legs:4",)) == "release"
    assert other.simulation.torque == [False] * 4 and len(gone.said) == 1, "the first bus was released by the loop"


def test_servos_that_were_to_be_held_are_all_named_where_one_cannot_be_released() -> None:
    left = Left(lambda count: GONE if count > 1 else None)
    left.simulation.fault("silence", servos=[2])
    left.after = replace(left.after, asked=lambda: int(left.opened > 2))
    assert bring_all_to_rest(left.lines, "hold", left.after, WHY, on=("2",)) is None
    assert left.noted[-1]["servos"] == ["1", "2", "3", "4"], "those that are held have torque"


def test_who_finds_servos_held_reads_how_they_are_released() -> None:
    left = Left()
    assert left.release("hold") == "hold"
    assert left.said[-1].endswith("It watches them; `kill 4711` releases them."), left.said
    assert left.noted[-1]["release"] == "kill 4711"


# --- servos that are held ----------------------------------------------------------------------------------------


def looked_at(left: Left, seconds: float, until: Callable[[], bool] = lambda: False) -> bool:
    """Look for so long; whether the watch ended."""
    left.watcher = watcher = left.watcher or HoldWatch(left.lines, left.after)
    end = left.now + seconds
    while left.now < end and not until():
        if watcher.look():
            return True
        left.after.clock.sleep(0.25)
    return False


def test_held_servos_are_watched_on_after_the_port_was_away_or_another_programs() -> None:
    away: list[Exception | None] = [None]
    left = Left(lambda count: away[0])
    assert not looked_at(left, 1.0)
    away[0] = BUSY
    assert not looked_at(left, 5.0) and left.said == [] and left.noted[-1]["event"] == "not watched"
    away[0] = GONE
    assert not looked_at(left, 5.0)
    assert [line.split(",")[0] for line in left.said] == [f"TORQUE MAY BE ON at servo(s) {k}" for k in (1, 2, 3, 4)]
    away[0] = None
    assert not looked_at(left, 1.0) and left.said[-1] == "servo 4 answers again."
    left.simulation.fault("overheat", servos=[3])
    assert looked_at(left, 2.0) and left.simulation.torque == [False] * 4
    assert left.noted[-1]["event"] == "at rest" and "hotter" in left.said[-1]


def test_a_silent_servo_is_named_and_keeps_no_other_one_from_being_watched() -> None:
    left = Left()
    left.simulation.fault("silence", servos=[2])
    assert not looked_at(left, 6.0)
    assert len(left.said) == 1 and left.said[0].startswith("TORQUE MAY BE ON at servo(s) 2, held and no longer watched")
    left.simulation.fault("overheat", servos=[4])
    assert not looked_at(left, 3.0), "one of them is not released yet"
    assert left.simulation.torque == [False, True, False, False]
    assert left.said[-1].startswith("TORQUE MAY BE ON at servo(s) 2: CUT THE POWER. They are to be released")
    left.simulation.wire.faults.clear()
    assert looked_at(left, 2.0) and left.simulation.torque == [False] * 4


def test_a_look_is_short_enough_for_another_program_to_get_the_port() -> None:
    left = Left()
    left.simulation.fault("silence")
    took: list[float] = []

    def timed() -> bool:
        begun = left.now
        watcher.look()
        took.append(left.now - begun)
        return len(took) > 12

    watcher = HoldWatch(left.lines, left.after)
    while not timed():
        left.after.clock.sleep(0.5)
    assert max(took) < 0.15, "for which a bus waits that finds its port in use"
    assert len(left.said) == 4, "each has its turn all the same"


def test_a_held_servo_that_lost_its_torque_is_named_and_the_others_are_held_on() -> None:
    left = Left()
    assert not looked_at(left, 1.0)
    left.simulation.fault("limp", servos=[3])
    assert not looked_at(left, 3.0) and left.simulation.torque == [True, True, False, True]
    assert left.said == ["servo 3 was held and has lost its torque; the others are held on."]
    assert left.simulation.bus.torque_off([1, 2, 4]) == {}
    assert looked_at(left, 2.0), "somebody else released them"


@pytest.mark.long
@pytest.mark.parametrize(
    ("bearable", "said"),
    [(Bearable(20.0, 9.0, 1.0), "degC; its limit is 20 degC"), (Bearable(99.0, 0.0, 1.0), "drew more than 0 A for 1")],
)
def test_held_servos_are_released_at_the_limits_of_the_run_that_left_them(bearable: Bearable, said: str) -> None:
    left = Left()
    left.simulation.bus.write_goals([1, 2, 3, 4], [0.5] * 4)
    watcher, begun = HoldWatch(left.lines, left.after, bearable=bearable), left.now
    while not watcher.look() and left.now < begun + 5.0:
        left.after.clock.sleep(0.25)
    assert left.simulation.torque == [False] * 4 and said in left.said[-1]
    assert said.startswith("degC") or left.now - begun > 1.0, "a moment is tolerated"
    patient = Left()
    patient.watcher = HoldWatch(patient.lines, patient.after, bearable=Bearable(99.0, 9.0, 1.0))
    assert not looked_at(patient, 3.0)


def test_a_charge_is_read_as_it_was_written() -> None:
    for given in (charge(), charge(bearable=Bearable(65.0, 1.0, 0.3), others=[{"bus": "legs"}])):
        assert Charge.read(given.written()) == given


def test_the_watch_ends_where_a_later_run_has_the_servos_even_if_they_were_to_be_released(tmp_path: Path) -> None:
    left = Left()
    older, other, later = (InCharge("/dev/ttyUSB0", ids, tmp_path) for ids in ([1, 2, 3, 4], [5], [4, 3, 2, 1]))
    older.claim()
    watcher = HoldWatch(left.lines, left.after, {"": older})
    assert not watcher.look() and not older.lost
    other.claim()
    assert not watcher.look(), "other servos on the same port are none of its business"
    left.asked = 1  # it is told to release them, and the port is in use
    left.opening = lambda count: BUSY
    assert not watcher.look()
    later.claim()
    left.opening = lambda count: None
    opened = left.opened
    assert watcher.look() and left.opened == opened and left.simulation.torque == [True] * 4
    assert left.noted[-1] == {"event": "watched by a later run", "by": "supervisor", "servos": ["1", "2", "3", "4"]}
    assert not later.lost
    for file in tmp_path.iterdir():
        file.unlink()
    assert not later.lost, "who clears temporary files away is no later run"


def test_servos_are_watched_without_a_place_for_claims(tmp_path: Path) -> None:
    left, nowhere = Left(), InCharge("/dev/ttyUSB0", [1, 2, 3, 4], tmp_path / "missing")
    nowhere.claim()
    assert not HoldWatch(left.lines, left.after, {"": nowhere}).look() and not nowhere.lost


def test_an_emergency_stop_releases_servos_that_are_held() -> None:
    left = Left()
    assert not looked_at(left, 1.0)
    left.pressed = True
    assert looked_at(left, 0.3) and left.simulation.torque == [False] * 4
    assert left.said == ["The servos that were held are released: the emergency stop was pressed."]


def test_servos_that_are_released_because_somebody_asked_are_told_in_a_sentence() -> None:
    """It read "are released: asked to"."""
    left = Left()
    left.asked = 1
    assert looked_at(left, 0.3) and left.simulation.torque == [False] * 4
    pid = left.after.pid
    assert left.said == [
        f"The servos that were held are released: process {pid}, which watched them, was asked to end."
    ]


def test_virtual_servos_that_are_held_and_end_with_their_run_are_told() -> None:
    """After `kill -9` they were gone 5 s later, and nothing said so."""
    away: list[Exception | None] = [None]
    left = Left(lambda count: away[0], lasting=False)
    assert not looked_at(left, 1.0)
    away[0] = GONE
    assert looked_at(left, 1.0)
    assert left.said == ["The virtual machine has ended with its run, and with it the servos that were held."]


def test_being_asked_twice_ends_a_watch_that_cannot_release() -> None:
    left = Left()
    left.simulation.fault("silence", servos=[1])
    left.asked = 1
    assert not looked_at(left, 2.0) and left.simulation.torque == [True, False, False, False]
    assert left.said[0].startswith("TORQUE MAY BE ON at servo(s) 1: CUT THE POWER.") and len(left.said) == 1
    left.asked = 2
    assert looked_at(left, 1.0)


# --- words of the loop -------------------------------------------------------------------------------------------


def charge(**keys: Any) -> Charge:
    return Charge("/dev/null", 1_000_000, "sts3215", 0.02, [1], "hold", 0.02, os.getpid(), **keys)


def ended(words: bytes, closed: bool = True, starting: Callable[[], None] = lambda: None) -> End | None:
    pipe, other = os.pipe()
    os.write(other, words)
    if closed:
        os.close(other)
    try:
        return watch(charge(), pipe, starting)
    finally:
        os.close(pipe)
        if not closed:
            os.close(other)


def test_a_loop_is_watched_from_the_moment_at_which_torque_comes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sealegs.hw.guard.supervision.PATIENT", 0.05)
    for words in (STARTING, STARTING + BEAT, RESTING):
        end = ended(words, closed=False)
        assert end is not None and end.hangs and "silent for 0.0" in end.why and "policy" not in end.why
    for words, named in ((BEAT + ASKING, True), (BEAT + ASKING + BEAT, False)):
        end = ended(words, closed=False)
        assert end is not None and end.hangs and ("its policy gave no goals" in end.why) == named
    assert ended(b"") is None, "torque never came on"
    begun: list[str] = []
    for words in (b"", RESTING + DONE, STARTING + STARTING + BEAT + RESTING + DONE):
        ended(words, starting=lambda: begun.append("claimed"))
    assert begun == ["claimed"], "from then on these servos are the new run's, and once is enough"
    assert ended(STARTING + BEAT + RESTING + DONE) is None
    end = ended(STARTING + BEAT)
    assert end is not None and not end.hangs and not end.called
    end = ended(BEAT + RESTING)
    assert end is not None and end.called
    end = ended(BEAT + RELEASE + RESTING)
    assert end is not None and end.release, "an emergency stop releases servos that were to be held"
    end = ended(BEAT + RELEASE)
    assert end is not None and end.release
    end = ended(RESTING + HELD)
    assert end is not None and end.held
    for words in (BEAT + RESTING + b'["2", "arm:3"]', RESTING + b'["2", "arm:3"]' + RELEASE):
        end = ended(words)
        assert end is not None and end.called and end.left == ("2", "arm:3"), "names are no words"
    assert end is not None and end.release
    for words in (RELEASE + RESTING + HELD, RESTING + HELD + RELEASE + RESTING, RESTING + HELD + RELEASE):
        end = ended(words)
        assert end is not None and end.release and not end.held, "pressed as they became held"


@pytest.mark.long
def test_tables_are_read_before_it_watches(tmp_path: Path) -> None:
    """A file that is edited, or a disk that is gone, once the loop has died, must not keep servos driven."""
    code = (
        "import json, sys\nfrom sealegs.hw.guard import supervision\nsupervision.main(lambda: sys.argv[1].encode())\n"
    )
    row = json.dumps({**vars(charge()), "servo": "lost"})
    done = subprocess.run([sys.executable, "-c", code, row], capture_output=True, text=True, timeout=60, input="")
    assert done.returncode != 0 and READY.decode() not in done.stdout and "no register table" in done.stderr


# --- lines on a terminal -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("error", [OSError(5, "Input/output error"), ValueError("I/O operation on closed file")])
def test_a_terminal_that_is_closed_ends_nothing(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    class Closed:
        def write(self, text: str) -> int:
            raise error

        def flush(self) -> None:
            raise error

    monkeypatch.setattr(sys, "stderr", Closed())
    simulation = Simulation("row")
    simulation.loop.alarm = Alarm()
    simulation.loop.each_cycle = lambda: simulation.fault("silence", servos=[2]) or "enough"
    outcome = simulation.run()
    assert list(outcome.not_at_rest) == [2] and simulation.torque == [False, True, False, False]
    assert simulation.guard.heard[-1] == "call"


def test_a_terminal_that_takes_nothing_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    reader, writer = os.pipe()
    os.set_blocking(writer, False)
    full = 0
    while full is not None:
        try:
            full = os.write(writer, b" " * 65536)
        except BlockingIOError:
            full = None
    os.set_blocking(writer, True)
    lines: list[str] = []
    with os.fdopen(writer, "w") as terminal:
        monkeypatch.setattr(sys, "stderr", terminal)
        alarm = Alarm()
        for k in range(20):
            alarm(f"line {k}")  # would wait for ever
        waiting = os.read(reader, 1 << 20)
        while b"line 19" not in waiting:
            waiting += os.read(reader, 1 << 20)
        lines = waiting.decode().split("\n")
        alarm.flush()
    os.close(reader)
    assert [line.strip() for line in lines if line.strip()] == [f"line {k}" for k in range(20)]


def test_an_alarm_that_fails_ends_neither_the_run_nor_the_way_to_rest() -> None:
    def broken(line: str) -> None:
        raise RuntimeError("no such loudspeaker")

    simulation = Simulation(latency=0.016, limits={"following_error": 9.0})
    simulation.loop.alarm = broken
    assert simulation.run(1.0).ending == "finished", "an adapter that is slow is no more than a warning"
    simulation = Simulation("row")
    simulation.loop.alarm = broken
    simulation.loop.each_cycle = lambda: simulation.fault("silence", servos=[1]) or "enough"
    assert list(simulation.run().not_at_rest) == [1] and simulation.torque == [True, False, False, False]
