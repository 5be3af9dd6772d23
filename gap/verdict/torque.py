"""Logs without commands: logged torque against the torque that the motion needs.

Both come from :mod:`sealegs.gap.checks.torque_balance`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...actuators.chain import load_chain
from ..checks.torque_balance import AT_ONCE, STEP, WINDOW, Shift, torque_balance, torque_shift
from ..load.pendulum import PendulumLoad, bench_parameters
from ..log.finding import Finding
from ..log.parts import held_out
from ..log.types import LogError, MeasuredRun
from .decide import decide, standing
from .evidence import Balanced
from .request import Request
from .torque_causes import SHIFT, Sought, owed_by, sought_in, torque_causes
from .verdict import WITHDRAWN, Error, JointDiagnosis, NamedCause, OpenCause, Value, data_errors

NO_WISHES = Request()
NUMBERS = ("inertia [kg.m2]", "gravity torque [N.m]", "coulomb [N.m]", "viscous [N.m.s/rad]", "offset [N.m]")


def diagnose_torque(
    runs: Sequence[MeasuredRun], joint: str, findings: tuple[Finding, ...], request: Request = NO_WISHES
) -> JointDiagnosis:
    """Diagnose a torque-driven log of a bench.

    The nominal model gives the torque from sidecar and chain. In the refitted one inertia, gravity, dry and viscous
    friction and offset are fitted. The extended one shifts the torque column in time as well. All are judged on blocks
    that neither a fit nor the choice of the shift has seen: those of the test group, or every other second. Runs
    without torque are left out.

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
    models = {k: _nominal(runs[k], joint) for k in logs}
    balance = torque_balance(list(logs.values()), [(inertia, gravity) for inertia, gravity, *_ in models.values()])
    if balance is None:
        raise LogError(f"joint '{joint}': a torque log of a second or more is needed; these are shorter.")
    test = np.isin(balance.run, [n for n, k in enumerate(logs) if k in held]) if held else (balance.block // 2) % 2 == 1
    if test.all() or not test.any():
        use = "fit" if test.all() else "test"
        group = f" with the group '{request.test_group}' held out" if held else ""
        raise LogError(f"joint '{joint}': no torque is left to {use} on{group}; record more runs or longer ones.")
    terms, torques = balance.terms, balance.torques
    fitted = balance.only(~test)
    first = next(iter(models.values()))
    nominal = np.array([1.0, 1.0, *first[2:]])
    believed = np.array([*first[:2], 1.0, 1.0, 1.0])
    errors = {"nominal": _error(terms[test] @ nominal - torques[test, AT_ONCE])}
    errors["refitted"] = _error(terms[test] @ fitted.fit(AT_ONCE) - torques[test, AT_ONCE])
    sought = sought_in(runs[next(iter(logs))], joint, request)
    found = torque_shift(fitted)
    extended = fitted.fit(found.index)
    errors["extended"] = _error(terms[test] @ extended - torques[test, found.index])
    errors["noise_floor"] = Error(_noise(runs, joint), _noise(runs, joint) * 0.8)

    open_causes: tuple[OpenCause, ...] = ()
    seen = [
        _error(terms[~test] @ values - torques[~test, at]).rmse
        for values, at in ((fitted.fit(AT_ONCE), AT_ONCE), (extended, found.index))
    ]  # the test part has no say in what is named, only in what is withdrawn
    causes: tuple[NamedCause, ...] = ()
    at = AT_ONCE
    excess = max(errors["nominal"].rmse ** 2 - errors["noise_floor"].rmse ** 2, 1e-12)
    low = found.size[0]
    shifted = found.same_side > 0.9 and low > 0.0 and seen[1] < 0.995 * seen[0] and abs(found.seconds) >= 2 * STEP
    if shifted and SHIFT in sought.causes:
        if errors["extended"].rmse < errors["refitted"].rmse:
            at, causes = found.index, (_shifted(found, errors, sought),)
        else:
            why = f"on held-out blocks the torque error rises: {_change(errors, 'refitted')}"
            open_causes = (OpenCause(SHIFT, WITHDRAWN, why),)
    if at == AT_ONCE:
        extended, errors["extended"] = fitted.fit(AT_ONCE), errors["refitted"]
    causes += torque_causes(fitted, nominal, at, errors["noise_floor"].rmse, sought)
    if causes and not errors["extended"].rmse < errors["nominal"].rmse:
        why = f"on held-out blocks the torque error rises: {_change(errors, 'nominal')}"
        open_causes += tuple(OpenCause(cause.name, WITHDRAWN, why) for cause in causes)
        causes, extended = (), nominal
        errors["withdrawn"], errors["extended"] = errors["extended"], errors["nominal"]
    left = float(np.clip((errors["extended"].rmse ** 2 - errors["noise_floor"].rmse ** 2) / excess, 0.0, 1.0))
    shares, tuned_share = owed_by(fitted, nominal, at, [cause.name for cause in causes]).shares(1.0 - left)
    every = [replace(cause, share=share) for cause, share in zip(causes, shares, strict=True)]
    causes = tuple(sorted(every, key=lambda cause: -cause.share))
    shift = found.seconds if any(cause.kind == "data" for cause in causes) else None
    verdict = decide(Balanced(joint, errors, causes, left, open_causes, shift))
    numbers: dict[str, float] = {key: float(value) for key, value in zip(NUMBERS, believed * extended, strict=True)}
    return JointDiagnosis(
        joint=joint,
        verdict=verdict.name,
        sentence=verdict.sentence,
        signal=f"{joint}.torque",
        unit="N.m",
        gap=errors,
        causes=causes,
        unexplained=left,
        rivals=(),
        experiment=None,
        findings=findings,
        tuned=numbers,
        reasons=verdict.reasons,
        data_errors=data_errors(findings, joint),
        tuned_share=tuned_share,
        open_causes=open_causes,
    )


def _shifted(found: Shift, errors: Mapping[str, Error], sought: Sought) -> NamedCause:
    """A torque column that is out of step, as a fault of the data that is fitted; without its share."""
    way = "leads" if found.seconds > 0 else "lags behind"
    sentence = (
        f"The torque column {way} the motion columns by {1e3 * abs(found.seconds):.0f} ms: torque and motion were not "
        "read at the same time."
    )
    value = Value(abs(found.seconds), *found.size, "s", 0.0)
    gain = 1.0 - errors["extended"].rmse / errors["refitted"].rmse
    cause, sure, numbers = sought.causes[SHIFT], found.same_side, {"torque.delay": value}
    return NamedCause(
        cause.name, sentence, sought.joint, 0.0, sure, numbers, gain, "data", cause.picture, (), standing(sure, ())
    )


def _change(errors: Mapping[str, Error], other: str) -> str:
    return f"{errors[other].rmse:.3g} to {errors['extended'].rmse:.3g} N.m"


def _nominal(run: MeasuredRun, joint: str) -> list[float]:
    """Inertia [kg.m2], gravity torque [N.m], coulomb [N.m], viscous [N.m.s/rad] and offset [N.m].

    A torque-driven log need not name an actuator; without one, nothing is believed of friction and armature.
    """
    if run.robot != "bench":
        raise LogError(
            f"{run.name}: joint '{joint}' of {run.robot} was driven by torque; what it works against is known for a "
            "bench only."
        )
    load, params = PendulumLoad(), bench_parameters(run.robot_params, run.name)
    chain = load_chain(run.actuators[joint]) if joint in run.actuators else None
    friction = chain.find("friction") if chain else None
    dry, viscous = (friction.coulomb, friction.viscous) if friction else (0.0, 0.0)
    inertia = load.inertia(params) + (chain.armature() if chain else 0.0)
    return [inertia, load.gravity_torque(params), dry, viscous, 0.0]


def _noise(runs: Sequence[MeasuredRun], joint: str) -> float:
    """Noise of the torque column after averaging [N.m], from differences of neighbouring samples.

    The estimator of the checks has a margin, which would hide causes here: it reads a fifth more.
    """
    values = []
    for run in runs:
        torque = run.joints[joint].torque
        if torque is not None and len(torque) > 3:
            jumps = np.diff(torque, 2)
            jumps = jumps[np.isfinite(jumps)]
            if len(jumps):
                values.append(
                    np.median(np.abs(jumps)) / 0.6745 / np.sqrt(6.0) / np.sqrt(max(WINDOW / run.period / 2.0, 1.0))
                )
    return float(np.median(values)) if values else 0.0


def _error(error: np.ndarray) -> Error:
    return Error(float(np.sqrt(np.mean(error**2))), float(np.mean(np.abs(error))))
