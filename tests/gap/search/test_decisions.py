"""What is named, and the page about thresholds, follow from a record and the settings alone."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sealegs.gap.search import seek, usual
from sealegs.gap.search.decide import Standing, decide, hopeless, in_place, pays, rivals_of, shortfalls, standings
from sealegs.gap.search.record import Evidence, RoundRecord, SearchRecord, Step, from_dict, load, save, to_dict
from sealegs.gap.search.seek import from_usual
from sealegs.gap.search.settings import DEFAULT, SearchSettings
from sealegs.gap.search.tied import GAIN, ended_tied

from benchmarks.kept import RESULTS
from benchmarks.sensitivity import RECORDS, disagreeing, tally, told
from tests.small_diagnosis import small_diagnosis

BLOCKS = 60
COUNTS = np.full(BLOCKS, 200)
RNG = np.random.default_rng(0)
BEFORE = 200.0 * (1.5 + 0.05 * RNG.standard_normal(BLOCKS))


def evidence(name: str, removed: float, **changes: object) -> Evidence:
    """A candidate that removes so much loss per judged value."""
    scatter = 200.0 * 0.02 * np.random.default_rng(len(name)).standard_normal(BLOCKS)
    plain = Evidence(
        name=name,
        number=False,
        parameters=1,
        usual=True,
        blocks=BEFORE - 200.0 * removed + scatter,
        sampled=1.0,
        distances=(1.0, 1.1),
        scale=1.0,
        contradicted=0.0,
        values=({}, {}),
    )
    return replace(plain, **changes)  # pyright: ignore[reportArgumentType]


def round_of(*candidates: Evidence, excess: float = 0.5, promise: float = 0.1) -> RoundRecord:
    return RoundRecord(COUNTS, BEFORE, 1.1, excess, excess, promise, candidates)


def named(*rounds: tuple[RoundRecord, str | None], settings: SearchSettings = DEFAULT) -> tuple[tuple[str, ...], bool]:
    found = decide(SearchRecord(0, tuple(Step(record, winner) for record, winner in rounds)), settings)
    return found.names, found.open


@pytest.mark.long
def test_a_record_decided_again_gives_the_names_of_the_search(tmp_path: Path) -> None:
    search = small_diagnosis()[0].search
    assert search is not None
    names = tuple(candidate.cause.name for candidate in search.accepted)
    assert names and decide(search.record, search.settings).names == names
    save(search.record, tmp_path / "record.json")
    again = decide(load(tmp_path / "record.json"), search.settings)
    assert again.names == names and not again.open


def test_of_several_variants_of_a_cause_the_best_stands_for_it() -> None:
    both = round_of(evidence("a", 0.3), evidence("a", 0.4), evidence("b", 0.35))
    assert named((both, None)) == (("a",), True)
    unusual = round_of(evidence("a", 0.3), evidence("a", 0.4, usual=False), evidence("b", 0.35))
    assert named((unusual, None)) == (("b",), True)


def test_of_causes_that_do_about_as_well_the_one_with_fewer_numbers_wins() -> None:
    """A centre of mass in three directions won over a payload by half a percent."""
    one, three = evidence("payload", 0.4, number=True), evidence("centre", 0.405, number=True, parameters=3)
    order = standings(round_of(one, three), DEFAULT, 0)
    assert order[0].index == 0 and order[0].best > 0.6
    better = evidence("centre", 0.5, number=True, parameters=3)
    assert standings(round_of(one, better), DEFAULT, 0)[0].index == 1


@pytest.mark.parametrize(
    "changes",
    [
        {"distances": (1.0, -1.0)},
        {"distances": (1.0, 3.0)},
        {"distances": (0.05, 0.05), "scale": 0.1},
        {"contradicted": 0.01},
    ],
)
def test_a_cause_that_the_parts_or_the_log_contradict_is_not_named(changes: dict[str, object]) -> None:
    assert named((round_of(evidence("a", 0.4)), "a")) == (("a",), False)
    assert named((round_of(evidence("a", 0.4, **changes)), None)) == ((), False)


def test_little_that_only_duty_and_current_show_is_not_enough() -> None:
    def paid(removed: float, sampled: float) -> bool:
        record = round_of(evidence("a", removed, sampled=sampled))
        return pays(record, Standing(0, 1.0, 1.0, 1.0, removed), DEFAULT, further=False)

    assert not paid(0.1, 1.1) and paid(0.1, 1.05) and paid(0.15, 1.1)


def test_a_weak_cause_must_take_away_what_neighbouring_errors_share() -> None:
    """A spring that followed the ticks of a coarse encoder lowered the loss by 0.093, and the excess by 0.019."""
    weak = Standing(0, 1.0, 1.0, 1.0, 0.093)

    def paid(after: float, standing: Standing = weak) -> bool:
        record = round_of(evidence("a", 0.093, sampled=1.0, excess=after), excess=0.051)
        return pays(record, standing, DEFAULT, further=True)

    assert not paid(0.033) and paid(0.005)
    assert paid(float("nan"))  # an old record does not have it
    assert paid(0.033, replace(weak, removed=0.4))  # no weak cause


def test_further_causes_that_share_the_win_are_named_as_rivals_where_they_remove_much() -> None:
    """Dry friction took half of what a double pendulum had left; for three laws of it fit alike, none was named."""

    def alike(removed: float, winner: str | None) -> SearchRecord:
        first, others = evidence("load.centre_of_mass", 0.4), [evidence(name, removed) for name in ("a", "b", "c")]
        rounds = (round_of(first), "load.centre_of_mass"), (round_of(*others, excess=0.5), winner)
        return SearchRecord(0, tuple(Step(record, name) for record, name in rounds))

    ties = replace(DEFAULT, shared_win_gain=GAIN)
    assert decide(alike(0.3, None), DEFAULT).names == ("load.centre_of_mass",)
    assert ended_tied(alike(0.3, None), ties) and not ended_tied(alike(0.06, None), ties)
    named_too = decide(alike(0.3, "a"), ties)
    assert named_too.names == ("load.centre_of_mass", "a") and set(named_too.rivals[1]) == {"b", "c"}
    single = SearchRecord(0, (Step(round_of(evidence("a", 0.3)), "a"), Step(round_of(evidence("b", 0.3)), None)))
    assert not ended_tied(single, ties), "one cause that pays is no tie"


def test_another_cause_takes_a_place_that_it_wins_in_most_draws() -> None:
    def then(*removed: float, excess: float = 0.5) -> tuple[str | None, tuple[str, ...]]:
        before = (Step(round_of(evidence("a", 0.3)), "a"), Step(round_of(evidence("b", 0.3)), "b"))
        asked = round_of(*(evidence(name, size) for name, size in zip("ac", removed, strict=False)), excess=excess)
        order = standings(asked, DEFAULT, 0)
        chosen = in_place(asked, order, "a", DEFAULT)
        return chosen, decide(SearchRecord(0, (*before, Step(asked, chosen, 0))), DEFAULT).names

    assert then(0.3, 0.1) == ("a", ("a", "b"))
    assert then(0.1, 0.3) == ("c", ("c", "b"))
    assert then(0.001) == (None, ("b",)), "beside the others it removes nothing"
    assert then(0.3, 0.1, excess=0.01) == (None, ("b",)), "the others leave nothing"


def test_a_further_cause_must_win_most_draws() -> None:
    record = round_of(evidence("a", 0.4))
    rare = Standing(0, 1.0, 0.4, 1.0, 0.4)
    assert pays(record, rare, DEFAULT, further=False) and not pays(record, rare, DEFAULT, further=True)


def test_a_record_keeps_that_a_run_led() -> None:
    rounds = (replace(round_of(evidence("a", 0.4)), led=True), round_of(evidence("b", 0.4)))
    kept = to_dict(SearchRecord(0, tuple(Step(one) for one in rounds)))
    assert [step.round.led for step in from_dict(kept).steps] == [True, False]
    del kept["steps"][0]["round"]["led"]  # of a record that was made before
    assert not from_dict(kept).steps[0].round.led


@pytest.mark.parametrize(
    ("removes", "excess", "led", "paid"),
    [
        (0.5, 2.0, False, True),  # what it leaves is little: a quarter of it is enough
        (2.0, 8.0, False, False),  # 6 are left: they may as well be what made it look good
        (2.0, 8.0, True, True),  # one run alone has shown it before
        (2.8, 8.0, False, True),
    ],
)
def test_a_further_cause_that_leaves_much_must_remove_a_fair_share_of_it(
    removes: float, excess: float, led: bool, paid: bool
) -> None:
    record = replace(round_of(evidence("a", removes), excess=excess), led=led)
    good = Standing(0, 1.0, 1.0, removes / excess, removes)
    assert pays(record, good, DEFAULT, further=True) is paid
    assert pays(record, good, DEFAULT, further=False)


@pytest.mark.parametrize(
    ("cost", "least", "excess", "passed_over"),
    [
        (16.0, 15.0, 20.0, False),
        (19.0, 15.0, 20.0, True),  # it gains less than half of what the best one does
        (20.9, 20.9, 20.0, True),  # 0.1 of 20: no cause pays that removes so little
        (20.9, 20.9, 2.0, False),  # where little is left, unseen data decide
    ],
)
def test_a_finalist_that_cannot_win_or_cannot_pay_is_not_fitted_to_the_parts(
    cost: float, least: float, excess: float, passed_over: bool
) -> None:
    assert hopeless(cost, least, 21.0, 21.0, excess, DEFAULT) is passed_over


@pytest.mark.parametrize(
    ("cost", "excess", "passed_over"),
    [
        (19.0, 20.0, True),  # 2 of 20: a further cause that leaves so much must remove 6
        (17.9, 20.0, False),
        (3.8, 3.2, False),  # what it leaves is little, so that it need not
        (4.1, 3.2, True),  # a further cause that removes nothing does not pay either
    ],
)
def test_a_further_finalist_is_passed_over_only_where_it_is_a_guess(
    cost: float, excess: float, passed_over: bool
) -> None:
    before = excess + 1.0
    assert hopeless(cost, cost, before, before, excess, DEFAULT, further=True) is passed_over


def test_a_decision_that_leaves_the_record_is_open() -> None:
    first, second = round_of(evidence("a", 0.4)), round_of(evidence("b", 0.01), excess=0.1)
    assert named((first, "a"), (second, None)) == (("a",), False)
    looser = replace(DEFAULT, least_removed=0.005, least_gain=0.01)
    assert named((first, "a"), (second, None), settings=looser)[1] == (
        "b" in named((first, "a"), (second, None), settings=looser)[0]
    )
    ended = round_of(excess=0.03, promise=float("nan"))
    assert named((first, "a"), (ended, None)) == (("a",), False)
    assert named((first, "a"), (ended, None), settings=replace(DEFAULT, least_excess=0.02)) == (("a",), True)
    assert named((first, "a"), settings=replace(DEFAULT, least_gain=0.9)) == ((), False)


def test_every_setting_says_what_it_means_and_can_be_set() -> None:
    assert all(meaning.endswith(".") for meaning in SearchSettings.meanings().values())
    assert set(SearchSettings.deciding()) < set(SearchSettings.meanings())
    with pytest.raises(AttributeError):
        DEFAULT.least_gain = 0.5  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize(("better", "first"), [(0.0, "drive.offset"), (0.1, "sensor.offset")])
def test_of_a_cause_and_its_limit_that_fit_alike_the_limit_comes_first(better: float, first: str) -> None:
    """Of goals that were shifted, the encoder's zero was told: a wrong number has precedence over a missing effect."""
    shifted = evidence("drive.offset", 0.4)
    zero = evidence("sensor.offset", 0.4, number=True, limit="drive.offset", blocks=shifted.blocks - 200.0 * better)
    record = round_of(shifted, zero, evidence("friction.viscous", 0.1))
    order = standings(record, DEFAULT, 0)
    assert record.candidates[order[0].index].name == first
    assert len(order) == 3 and sum(standing.best for standing in order) == pytest.approx(1.0)


def test_of_two_that_are_each_others_limit_the_better_comes_first() -> None:
    """A payload was told as another centre of mass, which fits worse, since each is the other's limit."""
    mass = evidence("load.mass", 0.4, number=True, limit="load.centre_of_mass")
    centre = replace(mass, name="load.centre_of_mass", limit="load.mass", blocks=mass.blocks * 1.03)
    order = standings(round_of(centre, mass), DEFAULT, 0)
    assert order[0].index == 1 and order[0].best > 0.5


ROWS = [json.loads(line) for line in RECORDS.read_text().splitlines()]


def test_records_decided_again_with_the_same_settings_give_the_names_of_their_searches() -> None:
    assert ROWS and disagreeing(ROWS) == []


@pytest.mark.long
def test_the_committed_page_is_what_the_records_and_the_settings_say_now() -> None:
    written = (RESULTS / "sensitivity.md").read_text(encoding="utf-8")
    assert written == told(ROWS), "python -m benchmarks.sensitivity"


def test_each_threshold_is_halved_and_doubled_and_the_page_has_it() -> None:
    text = told(ROWS[:2])
    for name in SearchSettings.deciding():
        assert f"| `{name}` |" in text
        assert DEFAULT.scaled(name, 0.5) != DEFAULT != DEFAULT.scaled(name, 2.0)


def test_thresholds_that_nothing_passes_name_nothing() -> None:
    found = tally(ROWS, SearchSettings(least_removed=1e6))
    assert (found.right, found.false, found.nulls) == (0, 0, 0)


def test_what_another_took_the_place_of_stays_its_rival_and_does_not_come_back() -> None:
    """A gear ratio took the place of a rotor's inertia by a hair, and stood there surely ever after."""
    record = round_of(quiet("gear", 0.134), quiet("rotor", 0.130))
    order = standings(record, DEFAULT, seed=0)
    assert in_place(record, order, "gear", DEFAULT) == "rotor"
    record = replace(record, barred=("rotor",))
    assert in_place(record, order, "gear", DEFAULT) == "gear"
    assert rivals_of(record, order, "gear", DEFAULT) == ("rotor",)
    written = from_dict(to_dict(SearchRecord(0, (Step(record, "gear", 0),))))
    assert written.steps[0].round.barred == ("rotor",)


def quiet(name: str, left: float) -> Evidence:
    """A candidate that leaves so little of what the noise is believed to be."""
    return evidence(name, 0.0, blocks=np.full(BLOCKS, 200.0 * left))


def test_causes_that_fit_alike_below_the_noise_are_not_told_apart() -> None:
    """A gear ratio beat the inertia of a rotor, surely, by 3 % of a loss that was an eighth of that of the noise."""
    one, other = standings(round_of(quiet("gear", 0.130), quiet("rotor", 0.134)), DEFAULT, seed=0)
    assert one.best < 0.8 and other.best > DEFAULT.rival_win_rate
    first, _ = standings(round_of(quiet("gear", 0.13), quiet("rotor", 0.4)), DEFAULT, seed=0)
    assert first.best > 0.95


def replaced(kept: Any, **changes: Any) -> Any:
    """A searcher with other settings; a search stays the one that it is."""
    return type(kept)(**{**vars(kept), **changes}) if hasattr(kept, "counts") else kept


@pytest.mark.parametrize(
    ("causes", "loss", "left", "begun_wins"),
    [(1, 9000.0, 0.1, False), (3, 9000.0, 0.1, True), (3, 9000.0, 20.0, True), (3, 13000.0, 0.1, False)],
    ids=["one", "better", "better, leaving much", "alike with more"],
)
def test_a_search_begins_with_usual_causes_and_with_nothing_and_the_better_stands(
    causes: int, loss: float, left: float, begun_wins: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A resistance stood for a heavier rotor, a late bus and a payload. What explains all is held against one cause."""
    asked: list[bool] = []
    monkeypatch.setattr(seek, "replace", replaced)
    monkeypatch.setattr(seek, "charged", lambda searcher, found: found.loss)
    monkeypatch.setattr(seek, "usual_causes", lambda searcher: SimpleNamespace(forms=range(causes)))
    monkeypatch.setattr(seek, "leaves_tie", lambda searcher, found: False)
    plain: dict[str, Any] = {"record": SearchRecord(0, ()), "fits": None, "loose": False, "settings": DEFAULT}
    begun: Any = SimpleNamespace(accepted=[1, 2, 3], loss=loss, **plain)
    other: Any = SimpleNamespace(accepted=[1, 2], loss=13010.0, **plain)

    class Asked(SimpleNamespace):
        def run(self, usual: object = None, *, single: bool = False, **taken_up: object) -> object:
            asked.extend([single] if usual is None else [])
            return other if usual is None else begun

    searcher: Any = Asked(
        settings=DEFAULT, progress=lambda text: None, counts=COUNTS, excess=lambda fits: left, begun=None
    )
    found, usual = from_usual(searcher)
    assert (found is begun, usual is not None) == (begun_wins, begun_wins)
    # what one cause explains as well is searched to its end
    assert asked == [causes > 1 and left < 1.0] + [False] * (causes > 1 and not begun_wins)


def test_a_usual_cause_that_the_log_contradicts_is_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stop that nothing pushes the joint on to has no standing at all."""
    gone = SimpleNamespace(evidence=evidence("contact.blocked", 0.5, contradicted=1.0))
    cause: Any = SimpleNamespace(key="contact.blocked")
    judged = SimpleNamespace(blocks=BEFORE, sampled=1.0, fits=None)
    searcher: Any = SimpleNamespace(
        settings=DEFAULT, counts=COUNTS, excess=lambda fits: 1.0, fit_both=lambda *of: None,
        judged=lambda fits: judged, parameters=lambda accepted: [], candidate=lambda *of: gone,
        standings=lambda record, fitted: (standings(record, DEFAULT, 0), []),
        recorded=lambda *of, promise: (round_of(gone.evidence), judged),
    )  # fmt: skip
    choice = SimpleNamespace(fitted=lambda forms, values: SimpleNamespace(fit=SimpleNamespace(cost=1.0)))
    monkeypatch.setattr(usual, "_choice", lambda searcher, forms: choice)
    found: Any = SimpleNamespace(current=judged, accepted=[])
    begun: Any = SimpleNamespace(forms=((cause, ()),), fit=SimpleNamespace(values={}))
    usual.begin_with(searcher, found, begun)
    assert not found.accepted


def test_a_search_begins_with_nothing_where_the_fit_of_all_usual_causes_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(searcher: object) -> None:
        raise np.linalg.LinAlgError("singular")

    monkeypatch.setattr(seek, "usual_causes", fails)
    said: list[str] = []
    searcher: Any = SimpleNamespace(progress=said.append, begun=None, run=lambda usual: "from nothing")
    assert from_usual(searcher) == ("from nothing", None)
    assert "singular" in said[-1]


@pytest.mark.parametrize(("size", "named"), [(0.003, False), (0.5, True)])
def test_an_effect_a_hundredth_of_a_typical_one_is_no_finding(size: float, named: bool) -> None:
    """Viscous friction of 0.3 % of a usual one was told beside a heavier rotor: another plant's dry friction."""
    few = evidence("friction.viscous", 0.4, distances=(size, 1.05 * size))
    lacks = shortfalls(round_of(few), standings(round_of(few), DEFAULT, 0)[0], DEFAULT, further=False)
    assert ("least_agreement" in {lack.setting for lack in lacks}) != named
