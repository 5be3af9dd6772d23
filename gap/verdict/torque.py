"""Logs without commands: logged torque against the torque that the motion needs.

Both come from :mod:`sealegs.gap.checks.torque_balance`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...actuators.chain import load_chain
from ..causes.catalogue import adjustable
from ..checks.signal import sample_noise
from ..checks.torque_balance import WEAK_FORM_WINDOW, Shift, TorqueBalance, acceleration_noise, shifted_balance
from ..log.finding import Finding
from ..log.parts import held_out
from ..log.torque_side import said_side, side_by_load, side_note
from ..log.types import LogError, MeasuredRun
from ..measure.case import Case
from ..measure.confidence import THRESHOLDS, standing
from ..measure.measured import Measured, error_of
from ..measure.named import Error, NamedCause, Value
from ..measure.unseen import furthest, handed_over, withdrawn
from ..prepare.request import Request
from ..replay.parameters import TIGHT, address
from ..search.settings import SearchSettings
from .decide import decide
from .evidence import Balanced
from .torque_causes import SHIFT, Sought, sought_in, terms_of, torque_causes, with_shares
from .torque_model import Believed, TorqueModel
from .verdict import JointDiagnosis, data_errors

NO_WISHES = Request()
NORMAL_MEAN = math.sqrt(2.0 / math.pi)  # mean size of normal noise, over its rms
MODELS = ("nominal", "tuned", "refitted", "extended")


def diagnose_torque(
    runs: Sequence[MeasuredRun], joint: str, findings: tuple[Finding, ...], request: Request = NO_WISHES
) -> JointDiagnosis:
    """Diagnose a torque-driven log of a bench.

    The nominal model gives the torque from sidecar and chain. In the tuned one its own numbers are fitted within their
    tolerance, in the refitted one up to fivefold. The extended one has causes beside tuned numbers, and may shift the
    torque column in time. All are judged on blocks that neither a fit nor a choice has seen: those of the test group,
    or every other second. Runs without torque are left out.

    Args:
        runs: of one machine.
        joint: that is judged.
        findings: about its log.
        request: what was asked for.

    Raises:
        LogError: the runs are too short or have no torque, or the test group does not exist.
    """
    findings = tuple(
        f for f in findings if not (f.cause == "sensor.delay" and f.column == f"{joint}.torque")
    )  # judged here, by the same balance
    held = held_out(runs, request.test_group)
    logs = {k: (run.time, run.joints[joint].position, run.joints[joint].torque) for k, run in enumerate(runs)}
    logs = {k: (time, position, torque) for k, (time, position, torque) in logs.items() if torque is not None}
    if not logs:
        raise LogError(f"joint '{joint}': no run has a goal or a torque that can be used; record one of them.")
    chains = {k: load_chain(runs[k].actuators[joint]) if joint in runs[k].actuators else None for k in logs}
    believed = [Believed.of(runs[k], joint, chains[k]) for k in logs]
    kept_back = [n for n, k in enumerate(logs) if k in held]

    def to_fit(balance: TorqueBalance) -> np.ndarray:
        test = np.isin(balance.run, kept_back) if held else (balance.block // 2) % 2 == 1
        if test.all() or not test.any():
            use = "fit" if test.all() else "test"
            group = f" with the group '{request.test_group}' held out" if held else ""
            raise LogError(f"joint '{joint}': no torque is left to {use} on{group}; record more runs or longer ones.")
        return ~test

    # a column that is out of step: judged with all terms refitted, so that no wrong number hides it
    shifted = shifted_balance(list(logs.values()), [(one.inertia, one.gravity) for one in believed], to_fit)
    if shifted is None:
        raise LogError(f"joint '{joint}': a torque log of a second or more is needed; these are shorter.")
    (balance, found), at_once = shifted, shifted[0].at_once
    seen_rows = to_fit(balance)
    settings, noise = request.search, _noise(runs, joint)
    sought = sought_in(runs[next(iter(logs))], joint, request)
    tuned, wide = (adjustable(sought.nominal, width) for width in (TIGHT, settings.refitted_by))
    fitted, unseen = (TorqueModel(balance.only(rows), believed, tuned) for rows in (seen_rows, ~seen_rows))

    # a column of the shaft or of the drive
    said, shaft = said_side([runs[k] for k in logs], joint), fitted.at_shaft
    torque, load, inside = fitted.balance.torques[:, found.index], shaft.balance.terms[:, :2], fitted.inside
    shown = side_by_load(torque, load, *inside, fitted.balance.block)
    if said or np.any(inside):
        why = "said" if said else "assumed" if shown is None else "shown"
        findings = (*findings, side_note(joint, said or shown or "shaft", why))
    if (said or shown) != "drive":
        fitted, unseen = shaft, unseen.at_shaft
    errors = {  # of what is fitted and of what is not, without and with the shift
        at: [rows.balance.terms @ fitted.balance.fit(at) - rows.balance.torques[:, at] for rows in (fitted, unseen)]
        for at in (at_once, found.index)
    }
    seen, kept = ([errors[at][k] for at in (at_once, found.index)] for k in (0, 1))
    at, causes, open_causes = at_once, (), ()
    if SHIFT in sought.causes and is_shifted(found, _rms(seen[1]) / _rms(seen[0]), settings):
        handed = handed_over(
            dict(zip(MODELS, (kept[0], kept[0], kept[0], kept[1]), strict=True)),
            "N.m",
            request.seed,
            settings.verdict_draws,
            named=True,
        )
        if handed.why:
            open_causes = withdrawn([SHIFT], handed.why)
        else:
            longest = max(float(np.ptp(time)) for time, _, _ in logs.values())
            at, causes = found.index, (_shifted(found, sought, longest),)
    causes += torque_causes(fitted, at, noise, sought)

    # what each model does on blocks that no fit has seen
    terms = terms_of([cause.name for cause in causes])
    changes = {
        "nominal": {},
        "tuned": fitted.fit([], at_once),
        "refitted": replace(fitted, tuned=wide).fit([], at_once),
        "extended": fitted.fit(terms, at),
    }
    of = {name: (terms, at) if name == "extended" else ((), at_once) for name in changes}
    off = {
        name: unseen.predicted(change, of[name][0]) - unseen.balance.torques[:, of[name][1]]
        for name, change in changes.items()
    }
    handed = handed_over(off, "N.m", request.seed, settings.verdict_draws, named=bool(causes))
    gap = {
        "nominal": error_of(off["nominal"]),
        "refitted": error_of(off["refitted"]),
        "extended": error_of(off[handed.model]),
    }
    if handed.why:
        open_causes += withdrawn((cause.name for cause in causes), handed.why)
        causes, gap["withdrawn"] = (), error_of(off["extended"])
    gap["noise_floor"] = Error(noise, noise * NORMAL_MEAN)
    excess = max(gap["nominal"].rmse ** 2 - noise**2, 1e-12)
    left = float(np.clip((gap["extended"].rmse ** 2 - noise**2) / excess, 0.0, 1.0))
    causes, tuned_share = with_shares(fitted, at, causes, 1.0 - left)
    shift = found.seconds if any(cause.name == SHIFT for cause in causes) else None
    turned = [(address(path).number, 1.0 + change) for path, change in changes["refitted"].items()]
    alike = _unknowable(fitted, noise, max(_noise_of_motion(runs[k], joint) for k in logs), settings)
    judged = gap | {"noise_floor": Error(alike, alike * NORMAL_MEAN)}
    verdict = decide(
        Balanced(
            joint, judged, causes, left, open_causes, shift, furthest(turned) if handed.model == "refitted" else ""
        )
    )
    chosen, named = changes[handed.model], {term.number for term in terms}
    measured = Measured(
        gap=gap,
        left=left,
        unexplained=left,
        causes=causes,
        tuned={address(path).number: 1.0 + change for path, change in chosen.items() if path not in named},
        tuned_share=tuned_share,
        open_causes=open_causes,
        model="extended" if handed.model == "tuned" else handed.model,
    )
    case = Case(joint, findings, f"{joint}.torque", "N.m")
    return JointDiagnosis(case, verdict, measured, data_errors=data_errors(findings, joint))


def is_shifted(found: Shift, ratio: float, settings: SearchSettings) -> bool:
    """Whether a shift of the torque column is more than chance and than what the method is off by.

    Args:
        found: the shift.
        ratio: error with it over that without it, on what was fitted.
        settings: thresholds of the search.
    """
    return (
        found.same_side > settings.shift_certainty
        and found.size[0] > 0.0
        and ratio < settings.shift_error
        and abs(found.seconds) >= settings.least_shift
    )


def _shifted(found: Shift, sought: Sought, longest: float) -> NamedCause:
    """A torque column that is out of step, as a fault of the data that is fitted; without its share and gain.

    At the end of what was tried it is no measurement: all that bounds it is the length of the longest run [s].
    """
    way = "leads" if found.seconds > 0 else "lags behind"
    size = f"at least {1e3 * found.size[0]:.0f} ms" if found.least else f"{1e3 * abs(found.seconds):.0f} ms"
    sentence = (
        f"The torque column {way} the motion columns by {size}: torque and motion were not read at the same time."
    )
    low, high = found.size
    value = Value(abs(found.seconds), low, min(high, longest), "s", 0.0)
    cause, numbers = sought.causes[SHIFT], {"torque.delay": value}
    sure = found.same_side * (THRESHOLDS.at_bound if found.least else 1.0)
    return NamedCause(
        cause.name, sentence, sought.joint, 0.0, sure, numbers, 0.0, "data", cause.picture, (), standing(sure, ())
    )


def _unknowable(model: TorqueModel, noise: float, motion: float, settings: SearchSettings) -> float:
    """Error of the averaged torque that asks for no cause [N.m].

    Beside the noise of the column, that of the acceleration, and what a torque column is calibrated to: a drive's own
    torque ripples with it.

    Args:
        model: of the stretches to fit on.
        noise: of the averaged torque [N.m].
        motion: of the averaged acceleration [rad/s2].
        settings: of the search.
    """
    inertia = max(one.inertia for one in model.believed)
    calibrated = settings.column_calibration * _rms(model.balance.torques[:, model.balance.at_once])
    return math.hypot(noise, inertia * motion, calibrated)


def _noise_of_motion(run: MeasuredRun, joint: str) -> float:
    """Noise of the averaged acceleration [rad/s2]."""
    return acceleration_noise(sample_noise(run.time, run.joints[joint].position), run.period)


def _noise(runs: Sequence[MeasuredRun], joint: str) -> float:
    """Noise of the torque column after averaging [N.m]: that of its samples over the root of how many are averaged.

    Dry friction makes the torque jump wherever the joint turns around.
    """
    values = []
    for run in runs:
        torque = run.joints[joint].torque
        if torque is None or not (good := np.isfinite(torque)).any():
            continue
        noise = sample_noise(run.time[good], torque[good], jumps=True)
        values.append(noise / np.sqrt(max(WEAK_FORM_WINDOW / run.period / 2.0, 1.0)))
    return float(np.median(values)) if values else 0.0


def _rms(error: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error**2)))
