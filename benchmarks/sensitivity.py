"""What each threshold of the search does when it is halved or doubled.

    python -m benchmarks.sensitivity --record     diagnoses hidden benches and keeps what their searches decided on
    python -m benchmarks.sensitivity              decides again and writes benchmarks/results/sensitivity.{md,png}

Nothing is fitted again: a record (:mod:`sealegs.gap.search.record`) holds the losses of all candidates, rounds that the
search skips included. Recording can be stopped and goes on; its seeds are of development (below 900).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from sealegs.common.markdown import page, table
from sealegs.gap.search.decide import decide
from sealegs.gap.search.record import from_dict
from sealegs.gap.search.settings import DEFAULT, SearchSettings
from sealegs.gap.search.structure import listed

from benchmarks.hidden import Case, run, said
from benchmarks.kept import RESULTS, Kept, command, study, write
from testbed import EFFECTS, STRANGERS

RECORDS = RESULTS / "sensitivity.jsonl"
DURATION = 9.0  # [s] of each of the three runs, so that a case takes half a minute
SCHEDULES = (("chirp", "steps"), ("multisine", "triangle"), ("lift_and_drop", "chirp"))


def single(name: str, magnitude: str, seed: int) -> Case:
    """A case that hides one effect."""
    return Case(((name, magnitude),), seed)


FIRST, FURTHER = 626, 48  # seed and number of the cases of every kind that come after those that were chosen


def further(number: int) -> Case:
    """A case of a row in which each effect comes, some of them only beside another: a null, a stranger, one or two."""
    names, size = sorted(EFFECTS), ("clear", "moderate", "faint")[number % 3]
    if number % 8 == 3:
        return Case((), 50_304 + number)
    if number % 16 == 7:
        return single(sorted(STRANGERS)[number // 16 % len(STRANGERS)], size, FIRST + number)
    first = (names[number % len(names)], size)
    if number % 4 == 1:
        return Case((first, (names[(number + 17) % len(names)], "clear")), FIRST + number)
    return Case((first,), FIRST + number)


CASES = (
    single("friction.coulomb", "moderate", 400),
    Case((), 50_300),
    single("drive.delay", "moderate", 8400),
    single("friction.load_dependent", "faint", 610),
    single("stranger.jams", "clear", 611),
    single("load.mass", "clear", 612),
    single("drive.gain", "faint", 613),
    Case((), 50_301),
    single("friction.stribeck", "moderate", 614),
    single("transmission.backlash", "moderate", 615),
    single("friction.asymmetric", "faint", 616),
    single("stranger.friction_drift", "moderate", 617),
    Case((), 50_302),
    single("sensor.delay", "moderate", 618),
    single("drive.deadband", "clear", 619),
    Case((("friction.coulomb", "clear"), ("transmission.backlash", "clear")), 620),
    single("drive.supply_sag", "moderate", 621),
    single("load.inertia", "faint", 622),
    Case((), 50_303),
    single("drive.rate_limit", "faint", 623),
    Case((("sensor.delay", "clear"), ("load.inertia", "clear")), 624),
    single("friction.viscous", "moderate", 625),
    *(further(number) for number in range(FURTHER)),
)
"""Cases that are recorded, in an order in which the first few are of every kind."""


@dataclass(frozen=True)
class Tally:
    """What a set of records says with some settings.

    Attributes:
        right: hidden effects that are named.
        rival: hidden effects that are not named, and are among the rivals of what is.
        false: names of what is not hidden, over all cases.
        nulls: cases that hide nothing and get a name.
        open: cases in which the search would have gone where nothing was recorded.
    """

    right: int = 0
    rival: int = 0
    false: int = 0
    nulls: int = 0
    open: int = 0


def tally(rows: Sequence[dict[str, Any]], settings: SearchSettings) -> Tally:
    """Decide all records again."""
    total = Tally()
    for row in rows:
        hidden, found = set(row["effects"]), decide(from_dict(row["record"]), settings)
        near = {name for rivals in found.rivals for name in rivals}
        total = Tally(
            total.right + len(hidden & set(found.names)),
            total.rival + len((hidden - set(found.names)) & near),
            total.false + len(set(found.names) - hidden),
            total.nulls + (not hidden and bool(found.names)),
            total.open + found.open,
        )
    return total


def disagreeing(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Cases whose record, decided again with the same settings, gives other names than the search gave: none."""
    found = []
    for row in rows:
        # of the search itself: what unseen data withdrew afterwards counts as found
        named = {next(iter(step["after"])) for step in row["rounds"] if step["accepted"]}
        if set(decide(from_dict(row["record"]), DEFAULT).names) != named:
            found.append(row["key"])
    return found


def told(rows: Sequence[dict[str, Any]]) -> str:
    """The page as markdown."""
    base = tally(rows, DEFAULT)
    hidden = sum(len(set(row["effects"]) & set(EFFECTS)) for row in rows)
    nulls = sum(not row["effects"] for row in rows)
    strangers = sum(bool(set(row["effects"]) & set(STRANGERS)) for row in rows)
    cells = (
        (f"`{name}`", f"{getattr(DEFAULT, name):g}",
         *(_cell(tally(rows, DEFAULT.scaled(name, factor)), base) for factor in (0.5, 2.0)),
         SearchSettings.meanings()[name])
        for name in SearchSettings.deciding()
    )  # fmt: skip
    others = len(SearchSettings.meanings()) - len(SearchSettings.deciding())
    return page(
        "What each threshold of the search does",
        f"Decided again from {len(rows)} recorded searches of hidden benches (three runs of {DURATION:g} s each): "
        f"{hidden} hidden effects, {nulls} nulls, {strangers} strangers. Nothing was fitted again. "
        "These are few cases: read directions, not rates.",
        f"With the thresholds as they are: {base.right} of {hidden} effects are named and {base.rival} more are among "
        f"the rivals; {base.false} names are of nothing hidden; {base.nulls} of {nulls} nulls get a name.",
        "Each cell below is *right names / false names / nulls with a name*. A number in brackets counts the cases in "
        "which the search would have gone on where nothing was recorded, so that it may have named more.",
        table(("setting", "value", "halved", "doubled", "meaning"), cells),
        f"Of {listed([f'`{name}`' for name in SearchSettings.from_one()])} the distance from one is halved and "
        "doubled. A dash: nothing changes.",
        "![Right and false names](sensitivity.png)",
        f"{others} settings more are not in the table. Some bound the effort: with another value other fits would be "
        "made, and no record tells what they would have found. Some decide only what is told beside the verdict. "
        "[Thresholds](../../docs/thresholds.md) lists all of them.",
        "## Cases",
        "\n".join(
            f"- {row['key'].strip()}: {', '.join(decide(from_dict(row['record']), DEFAULT).names) or '-'}"
            for row in rows
        ),
        f"Recorded with revision {', '.join(sorted({row['revision'] for row in rows}))}. Made by "
        "`python -m benchmarks.sensitivity`; `--record` adds cases.",
    )


def _cell(found: Tally, base: Tally) -> str:
    if found == base:
        return "-"
    more = f" ({found.open} open)" if found.open else ""
    return f"{found.right} / {found.false} / {found.nulls}{more}"


def picture(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Right and false names with each threshold halved and doubled."""
    from matplotlib.figure import Figure

    names = SearchSettings.deciding()
    base = tally(rows, DEFAULT)
    tallies = {factor: [tally(rows, DEFAULT.scaled(name, factor)) for name in names] for factor in (0.5, 2.0)}
    figure = Figure(figsize=(9.0, 0.32 * len(names) + 1.8), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, count, title in zip(panels, ("right", "false"), ("hidden effects named", "false names"), strict=True):
        axes.axvline(getattr(base, count), color="#999999", lw=1.0)
        for factor, marker, colour, shift in ((0.5, "<", "#1f77b4", -0.15), (2.0, ">", "#d62728", 0.15)):
            values = [getattr(found, count) for found in tallies[factor]]
            label = "halved" if factor < 1.0 else "doubled"
            axes.plot(values, [k + shift for k in range(len(names))], marker, color=colour, label=label, ms=6)
        axes.set_yticks(range(len(names)), names)
        axes.set_title(title)
        axes.grid(axis="x", alpha=0.3)
        most = max(getattr(found, count) for found in (base, *tallies[0.5], *tallies[2.0]))
        axes.set_xlim(-0.5, max(most, 4) + 0.5)
        axes.xaxis.get_major_locator().set_params(integer=True)
    panels[0].invert_yaxis()
    panels[1].legend(loc="lower right", fontsize=8)
    figure.supxlabel(f"count over {len(rows)} recorded cases; line: thresholds as they are", fontsize=9)
    figure.savefig(path, dpi=120)


@study
def main() -> int:
    """Command line."""
    parser = command(__doc__)
    parser.add_argument("--record", action="store_true", help="diagnose the cases that are not recorded yet")
    kept = Kept(RECORDS)
    if parser.parse_args().record:
        one = partial(run, look_on=True, duration=DURATION, schedules=SCHEDULES)
        kept.run(one, [case for case in CASES if case.key not in kept], said)
    if not kept.rows:
        print(f"{RECORDS} has no cases; record some: python -m benchmarks.sensitivity --record")
        return 2
    if wrong := disagreeing(kept.rows):
        print(f"decided again with the same settings, other names come of {', '.join(wrong)}; record them anew.")
        return 1
    write("sensitivity", told(kept.rows))
    picture(kept.rows, RESULTS / "sensitivity.png")
    print(RESULTS / "sensitivity.md")
    return 0


if __name__ == "__main__":
    sys.exit(main())
