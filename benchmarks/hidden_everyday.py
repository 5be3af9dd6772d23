"""The finder against everyday machines: three to six effects at once, some of them shared by all joints.

``python -m benchmarks.hidden_everyday`` (``make hidden-everyday``) draws 60 machines (:mod:`testbed.everyday`), and
writes ``results/hidden_everyday.md`` from ``hidden_everyday.jsonl``, where every machine that is done is kept: it can
be stopped and goes on. ``--count 8`` does the first eight, ``--seed 1`` those of another draw, which are kept in the
file that ``--out`` names. Seeds below 900 are for development. Those of 2900 to 2903 and
3900 to 3908 were looked at since, too.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from sealegs.common.markdown import page, table

from benchmarks.hidden import SURE, revision, row_of
from benchmarks.kept import RESULTS, Kept, command, study, write
from testbed.everyday import Drawn, drawn
from testbed.everyday.machines import BENCH
from testbed.everyday.recorded import effect_of_each

FIRST = 4900
COUNT = 60
ROBOT = "robot"
"""Name of what all joints share, in a diagnosis."""
VISIBLE = 2.0
"""Change of a joint's position, in noise floors, from which its largest effect must be named."""
AT_NOISE = 1.5
LEFT = 0.1
"""Error on a fresh motion that counts as reached: in noise floors, or as a share of that of the nominal model."""
PAYLOAD_NEAR, BODY_NEAR = 0.15, 0.10


def run(number: int, seed: int) -> dict[str, Any]:
    """Record and diagnose one machine, and judge the model that is handed over on a fresh motion."""
    from sealegs.gap.finder.diagnosis import diagnose

    from testbed.logs import hidden_everyday

    case = drawn(number, seed)
    moved = effect_of_each(case)
    with tempfile.TemporaryDirectory() as folder:
        data, truth = hidden_everyday(case, Path(folder))
        began = time.perf_counter()
        found = diagnose(data)
        seconds = time.perf_counter() - began
        fresh, masses = _handed_over(case, data, found, Path(folder))
    return {
        "key": f"{case.name} {case.kind} #{seed}",
        "revision": revision(),
        "seconds": seconds,
        "log_seconds": case.duration * case.runs,
        "effects": truth["effects"],
        "moved": {joint: moved[:, k].tolist() for k, joint in enumerate(case.machine.joints)},
        "tip": case.machine.tip,
        "tip_mass": [case.machine.tip_mass, case.with_effects(case.effects)[1]],
        "masses": {
            f"{body.joint}_link": [body.mass, float(mass)]
            for body, mass in zip(case.machine.bodies, case.masses, strict=True)
        },
        "found_masses": masses,
        "fresh": fresh,
        "joints": {
            one.joint: {
                "verdict": one.verdict,
                "sentence": one.sentence,
                "model": one.model,
                "gap": {name: error.rmse for name, error in one.gap.items()},
                "shared": dict(one.shared_shares),
                "tuned": one.tuned_share,
                "unexplained": one.unexplained,
                "causes": [row_of(cause) for cause in one.causes],
                "open": [[cause.name, cause.standing] for cause in one.open_causes],
            }
            for one in found
        },
    }  # fmt: skip


def _handed_over(case: Drawn, data: Any, found: Sequence[Any], folder: Path) -> tuple[dict[str, Any], dict[str, float]]:
    """Errors of each joint on a fresh motion, of the nominal model and of that which is handed over; and the masses of
    its bodies [kg].
    """
    from sealegs.gap.finder.diagnosis import prepared
    from sealegs.gap.output.hand_over import confirm_whole, hand_over
    from sealegs.gap.prepare.request import Request

    from testbed.logs import hidden_everyday

    fresh, _ = hidden_everyday(case, folder, fresh=True)
    if case.name == "bench":
        (one,) = found
        problem = prepared(fresh, one.joint, Request()).problem
        rows = [problem.position_error(channels) for channels in problem.simulate([{}, one.values])]
        errors = dict(zip(("nominal", "extended"), (float(np.sqrt(np.mean(row**2))) for row in rows), strict=True))
        factor = one.values.get("load.mass_factor", 1.0)
        return {one.joint: errors}, {case.machine.tip: BENCH["mass"] * factor + one.values.get("load.payload", 0.0)}
    extended, confirmed = hand_over(found, data)
    if extended is None:
        return {}, {}
    taken = (confirmed or {}).get("taken", "all")
    judged = confirm_whole(found, fresh, extended, taken=taken) or {}
    masses = {f"{body.joint}_link": body.mass for body in case.machine.bodies} | {
        case.machine.tip: case.machine.tip_mass
    }
    for change in extended.changes:
        if change.joint in masses and change.path == "body.mass_factor":
            masses[change.joint] *= change.after
        elif change.joint in masses and change.path == "body.payload":
            masses[change.joint] += change.after
    return judged.get("joints", {}) | ({"reason": judged["reason"]} if "reason" in judged else {}), masses


# --- judging -----------------------------------------------------------------------------------------------------


def largest(row: Mapping[str, Any], joint: str) -> dict[str, Any] | None:
    """The effect that moves a joint most; None where none moves it visibly."""
    moved = row["moved"].get(joint, [])
    floor = row["joints"][joint]["gap"].get("noise_floor", np.inf)
    if not moved or max(moved) < VISIBLE * floor:
        return None
    return row["effects"][int(np.argmax(moved))]


def named_first(row: Mapping[str, Any], joint: str) -> tuple[str, dict[str, Any]] | None:
    """Where the largest value of a joint was found, and the cause: its own, or the one that all joints share and that
    does most at this one. Rows of earlier revisions have one share for all of these.
    """
    own, shared = row["joints"][joint], {c["name"]: c for c in row["joints"].get(ROBOT, {"causes": []})["causes"]}
    first = own["causes"][0] if own["causes"] else None
    shares = own["shared"] if isinstance(own["shared"], Mapping) else dict.fromkeys(list(shared)[:1], own["shared"])
    ordered = sorted((name for name in shares if name in shared), key=lambda name: -float(shares[name] or 0.0))
    most = next(iter(ordered), None)
    if most is not None and (first is None or shares[most] >= first["share"]):
        return ROBOT, shared[most]
    return None if first is None else (joint, first)


def holds(row: Mapping[str, Any], effect: Mapping[str, Any], cause: Mapping[str, Any]) -> bool:
    """Whether the interval of a cause holds the size of an effect."""
    believed, real = row["tip_mass"]
    for path, (_, low, high, *_) in cause["parameters"].items():
        number = path.rsplit("|", 1)[-1].rstrip("*")
        if effect["name"] == "payload":
            told = {"mass_factor": real / believed, "payload": real - believed}
            told = [value for key, value in told.items() if number.endswith(key)]
        else:
            told = effect["values"] if any(number.endswith(name) for name in effect["number"]) else []
        if any(low <= value <= high for value in told):
            return True
    return False


def right_first(row: Mapping[str, Any], joint: str) -> str:
    """``right``, ``size`` (right name, the interval does not hold the truth), ``rival`` (another name, of one that the
    log is said not to tell from the right one), ``wrong``, or ``none`` named; empty where nothing was to be named.
    """
    effect = largest(row, joint)
    if effect is None or not effect["cause"]:
        return ""
    named = named_first(row, joint)
    if named is None:
        return "none"
    where, cause = named
    if where == ROBOT and effect["joint"]:
        return "wrong"
    if cause["name"] not in effect["cause"]:
        return "rival" if set(cause["rivals"]) & set(effect["cause"]) else "wrong"
    return "right" if holds(row, effect, cause) else "size"


def false_names(row: Mapping[str, Any]) -> tuple[list[str], int]:
    """What is named with confidence and hidden neither there nor everywhere, and how many are named so."""
    false, count = [], 0
    for joint, item in row["joints"].items():
        for cause in item["causes"]:
            if cause["confidence"] < SURE:
                continue
            count += 1
            where = [e for e in row["effects"] if e["joint"] in ("", joint) or joint == ROBOT]
            if not any(cause["name"] in effect["cause"] for effect in where):
                false.append(f"{joint}: {cause['name']}")
    return false, count


def one_latency(row: Mapping[str, Any]) -> bool | None:
    """Whether a latency of the bus is told once, within its interval; None where there is none, or one joint."""
    hidden = next((e for e in row["effects"] if e["name"] == "latency"), None)
    if hidden is None or len(row["moved"]) < 2:
        return None
    shared = row["joints"].get(ROBOT, {"causes": []})["causes"]
    told = [cause for cause in shared if cause["name"] == "drive.delay"]
    alone = any(c["name"] == "drive.delay" for j in row["moved"] for c in row["joints"][j]["causes"])
    return bool(told) and not alone and holds(row, hidden, told[0])


def payload_right(row: Mapping[str, Any]) -> bool | None:
    """Whether the mass at the tip is within 15 %; None where no payload is hidden."""
    if not any(e["name"] == "payload" for e in row["effects"]) or row["tip"] not in row["found_masses"]:
        return None
    return abs(row["found_masses"][row["tip"]] / row["tip_mass"][1] - 1.0) <= PAYLOAD_NEAR


def bodies_right(row: Mapping[str, Any]) -> list[bool]:
    """Of each body that is as believed, whether it is within 10 % of what it weighs."""
    found = row["found_masses"]
    return [abs(found[name] / real - 1.0) <= BODY_NEAR for name, (_, real) in row["masses"].items() if name in found]


def predicted(row: Mapping[str, Any]) -> list[tuple[bool, bool]]:
    """Of each joint, whether the error on a fresh motion is as small as asked, and whether it is worse than nominal."""
    found = []
    for joint, errors in row["fresh"].items():
        if joint == "reason":
            continue
        noise = row["joints"][joint]["gap"].get("noise_floor", 0.0)
        nominal, extended = errors["nominal"], errors["extended"]
        found.append((extended <= max(LEFT * nominal, AT_NOISE * noise), extended > nominal + 0.1 * noise))
    return found


def figures(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, int, int]]:
    """What is asked of the finder: words, how often, of how many."""
    first = [r for row in rows for joint in row["moved"] if (r := right_first(row, joint))]
    false = [false_names(row) for row in rows]
    told = [one for row in rows if (one := one_latency(row)) is not None]
    weighed = [one for row in rows if (one := payload_right(row)) is not None]
    still = [one for row in rows for one in bodies_right(row)]
    fresh = [one for row in rows for one in predicted(row)]
    return [
        ("largest effect of a joint named first, with the truth in its interval", first.count("right"), len(first)),
        ("the same, whatever its interval", first.count("right") + first.count("size"), len(first)),
        ("another first, which is said not to be told from it", first.count("rival"), len(first)),
        (f"causes named with {SURE:g} or more that are false", sum(len(f) for f, _ in false), sum(n for _, n in false)),
        ("fresh motion: joints within a tenth of nominal, or 1.5 noise floors", sum(a for a, _ in fresh), len(fresh)),
        ("fresh motion: joints worse than nominal", sum(b for _, b in fresh), len(fresh)),
        ("a latency of the bus told as one", sum(told), len(told)),
        ("payload within 15 % at its body", sum(weighed), len(weighed)),
        ("other bodies within 10 %", sum(still), len(still)),
    ]  # fmt: skip


def told(rows: Sequence[Mapping[str, Any]]) -> str:
    """The results as Markdown."""
    made = sorted({row["revision"] for row in rows})
    found: list[tuple[object, ...]] = [
        (what, good, count, f"{good / max(count, 1):.0%}") for what, good, count in figures(rows)
    ]
    for name in dict.fromkeys(row["key"].split()[0] for row in rows):
        took = [row["seconds"] for row in rows if row["key"].startswith(f"{name} ")]
        found.append((f"seconds of a diagnosis, {name}, median", f"{np.median(took):.0f}", "", ""))
    head = ("machine", "joint", "hidden, largest first [mrad]", "named", "fresh motion: nominal, extended [mrad]")
    cells = []
    for row in rows:
        for joint, item in row["joints"].items():
            moved = row["moved"].get(joint, [])
            hidden = [
                f"{row['effects'][k]['name']} {1e3 * moved[k]:.0f}" for k in np.argsort(moved)[::-1] if moved[k] > 1e-3
            ]
            named = [f"{c['name']} {c['confidence']:.2f} ({c['share']:.0%})" for c in item["causes"]]
            errors = row["fresh"].get(joint)
            fresh = "-" if errors is None else f"{1e3 * errors['nominal']:.1f}, {1e3 * errors['extended']:.1f}"
            cells.append((row["key"], joint, ", ".join(hidden) or "-", ", ".join(named) or "-", fresh))
    return page(
        "Everyday machines",
        f"{len(rows)} machines with three to six effects at once (`testbed/everyday`), as a hobbyist records them; "
        "nominal numbers are 5 % wrong. Made by `python -m benchmarks.hidden_everyday`, which can be stopped and goes "
        f"on. Revision of gap, actuators and testbed: {', '.join(made)}.",
        table(("", "found", "of", ""), found),
        table(head, cells),
    )


@study
def main() -> None:
    """Run what is not done yet, and write the page of all that is done."""
    parser = command(__doc__)
    parser.add_argument("--count", type=int, default=COUNT, help="machines, the first ones")
    parser.add_argument("--seed", type=int, default=FIRST, help="of the first machine")
    parser.add_argument("--only", default="", help="words of the machines' names")
    parser.add_argument("--out", type=Path, default=RESULTS / "hidden_everyday.jsonl", help="where rows are kept")
    chosen = parser.parse_args()
    if chosen.seed != FIRST and chosen.out.parent == RESULTS:
        parser.error("another draw needs --out, so that the results stay those of the reported seeds.")
    kept = Kept(chosen.out)
    machines = [drawn(number, chosen.seed + number) for number in range(chosen.count)]
    keys = [f"{case.name} {case.kind} #{case.seed}" for case in machines]
    todo = [(k, machines[k].seed) for k, key in enumerate(keys) if key not in kept and chosen.only in key]
    kept.run(lambda case: run(*case), todo, lambda row: str({joint: right_first(row, joint) for joint in row["moved"]}))
    write(kept.file.with_suffix(""), told(kept.rows))
    print(*(f"{what}: {good} of {count}" for what, good, count in figures(kept.rows)), sep="\n")


if __name__ == "__main__":
    sys.exit(main())
