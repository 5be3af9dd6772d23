"""Logs without commands: the logged torque against the torque that the motion needs.

The equation of motion is tested in its weak form: both sides are averaged with a smooth window, and derivatives are
moved from the noisy position onto the window by partial integration, so nothing measured is ever differentiated.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import fftconvolve

from actuators.chain import load_chain
from gap.diagnosis import EXPLAINED, NOTHING, PARTLY, Error, JointDiagnosis, NamedCause, Value
from gap.joint_model import JointModel, bench_parameters
from gap.log_checks.finding import Finding
from gap.log_types import MeasuredRun

STEP = 1e-3  # [s] grid that logs are brought to
WINDOW = 0.15  # [s] of the weak form: short against the motion, long against the noise of positions
SHIFTS = np.arange(-40, 41) * STEP  # [s] tried between torque and motion
BLOCK = 0.5  # [s]
SLIP = 0.05  # [rad/s] over which dry friction turns around
DRAWS = 300


def diagnose_torque(runs: Sequence[MeasuredRun], joint: str, findings: tuple[Finding, ...]) -> JointDiagnosis:
    """Diagnose a torque-driven log of a bench.

    The nominal model gives the torque from sidecar and chain; re-tuning fits inertia, gravity, dry and viscous friction
    and offset; the extension shifts the torque column in time. All are judged on blocks (every other second) that were
    not fitted.
    """
    findings = tuple(
        f for f in findings if not (f.cause == "sensor.delay" and f.column and f.column.endswith("torque"))
    )  # judged here
    pieces = [_weak_form(run, joint) for run in runs]
    terms = np.concatenate([piece[0] for piece in pieces])
    torques = np.concatenate([piece[1] for piece in pieces])  # (n, shifts)
    block = np.concatenate([piece[2] + 1000 * k for k, piece in enumerate(pieces)])
    _, block = np.unique(block, return_inverse=True)
    fitted, test = (block // 2) % 2 == 0, (block // 2) % 2 == 1
    zero = int(np.argmin(np.abs(SHIFTS)))
    nominal = _nominal(runs[0], joint)
    errors = {"nominal": _error(terms[test] @ nominal - torques[test, zero])}
    retuned = _fit(terms[fitted], torques[fitted, zero])
    errors["retuned"] = _error(terms[test] @ retuned - torques[test, zero])
    # The shift is the centre of what resampled data say: one pass over a few seconds hangs on single manoeuvres.
    rng = np.random.default_rng(0)
    count = int(block.max()) + 1
    draws = rng.multinomial(count, np.full(count, 1 / count), DRAWS)
    drawn = np.array([SHIFTS[_best_shift(terms, torques, weight, block)] for weight in draws])
    best = int(np.argmin(np.abs(SHIFTS - np.median(drawn))))
    extended = _fit(terms[fitted], torques[fitted, best])
    errors["extended"] = _error(terms[test] @ extended - torques[test, best])
    errors["noise_floor"] = Error(_noise(runs, joint), _noise(runs, joint) * 0.8)

    shift = float(SHIFTS[best])
    low, high = np.percentile(np.abs(drawn), [2.5, 97.5])
    gain = 1.0 - errors["extended"].rmse / errors["retuned"].rmse
    same_side = float(np.mean(np.sign(drawn) == np.sign(shift))) if shift else 0.0
    causes: tuple[NamedCause, ...] = ()
    excess = max(errors["nominal"].rmse ** 2 - errors["noise_floor"].rmse ** 2, 1e-12)
    left = float(np.clip((errors["extended"].rmse ** 2 - errors["noise_floor"].rmse ** 2) / excess, 0.0, 1.0))
    if same_side > 0.9 and gain > 0.005 and abs(shift) >= 2 * STEP:
        way = "leads" if shift > 0 else "lags behind"
        sentence = (
            f"The torque column {way} the motion columns by {1e3 * abs(shift):.0f} ms: torque and motion were not read "
            "at the same time."
        )
        value = Value(abs(shift), float(low), float(high), "s", 0.0)
        share = max((errors["retuned"].rmse ** 2 - errors["extended"].rmse ** 2) / excess, 0.0)
        causes = (
            NamedCause(
                "sensor.delay", sentence, joint, share, same_side, {"torque.delay": value}, gain, "data", "response"
            ),
        )
    verdict = (EXPLAINED if left < 0.15 else PARTLY) if causes else NOTHING if left < 0.05 else PARTLY
    names = (
        causes[0].sentence
        if causes
        else "Re-tuned inertia, gravity and friction leave no shift between torque and motion."
    )
    change = (
        f"The torque that the motion needs differs from the logged one by {errors['nominal'].rmse:.2f} N.m with the "
        f"sidecar's numbers, {errors['retuned'].rmse:.2f} re-tuned, {errors['extended'].rmse:.2f} N.m with the shift "
        "(held-out blocks)."
    )
    keys = ("inertia [kg.m2]", "gravity torque [N.m]", "coulomb [N.m]", "viscous [N.m.s/rad]", "offset [N.m]")
    numbers: dict[str, float] = {key: float(value) for key, value in zip(keys, extended, strict=True)}
    return JointDiagnosis(
        joint,
        verdict,
        f"{names} {change}",
        f"{joint}.torque",
        "N.m",
        errors,
        causes,
        left,
        (),
        None,
        findings,
        retuned=numbers,
    )


def _weak_form(run: MeasuredRun, joint: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Terms (m, 5), torque at every shift (m, shifts) and block (m,) of one run."""
    log = run.joints[joint]
    time = np.arange(run.time[0], run.time[-1], STEP)
    position = np.interp(time, run.time, log.position)
    torque = np.interp(time, run.time, log.torque if log.torque is not None else np.zeros(len(run.time)))
    half = int(WINDOW / STEP / 2)
    s = np.linspace(-1.0, 1.0, 2 * half + 1)
    width = half * STEP
    window = (1 - s**2) ** 4
    first = -8 * s * (1 - s**2) ** 3 / width
    second = (-8 * (1 - s**2) ** 3 + 48 * s**2 * (1 - s**2) ** 2) / width**2
    scale = STEP / (window.sum() * STEP)

    def averaged(values: np.ndarray, kernel: np.ndarray) -> np.ndarray:
        return fftconvolve(values, kernel[::-1], "same") * scale

    speed = -averaged(position, first)
    columns = [
        averaged(position, second),
        averaged(np.sin(position), window),
        averaged(np.tanh(speed / SLIP), window),
        speed,
        np.ones_like(time),
    ]
    shifted = [averaged(np.interp(time - shift, time, torque), window) for shift in SHIFTS]
    inside = np.arange(half + len(SHIFTS), len(time) - half - len(SHIFTS), 5)
    block = ((time[inside] - time[0]) / BLOCK).astype(int)
    return np.stack(columns, axis=1)[inside], np.stack(shifted, axis=1)[inside], block


def _fit(terms: np.ndarray, torque: np.ndarray) -> np.ndarray:
    return np.linalg.lstsq(terms, torque, rcond=None)[0]


def _best_shift(terms: np.ndarray, torques: np.ndarray, weight: np.ndarray, block: np.ndarray) -> int:
    """Index of the shift that explains most of the torque's variance, blocks weighted."""
    w = np.sqrt(np.asarray(weight, float)[block])[:, None]
    use = w[:, 0] > 0
    basis, _ = np.linalg.qr((terms * w)[use])
    y = (torques * w)[use]
    rest = (y**2).sum(axis=0) - ((basis.T @ y) ** 2).sum(axis=0)
    return int(np.argmin(rest / (y**2).sum(axis=0)))


def _nominal(run: MeasuredRun, joint: str) -> np.ndarray:
    model = JointModel(load_chain(run.actuators[joint]))
    params = bench_parameters(run.robot_params, run.name)
    friction = model.chain.find("friction")
    inertia = model.load.inertia(params) + model.chain.armature()
    return np.array(
        [
            inertia,
            model.load.gravity_torque(params),
            friction.coulomb if friction else 0.0,
            friction.viscous if friction else 0.0,
            0.0,
        ]
    )


def _noise(runs: Sequence[MeasuredRun], joint: str) -> float:
    """Noise of the torque column after averaging [N.m], from differences of neighbouring samples."""
    values = []
    for run in runs:
        torque = run.joints[joint].torque
        if torque is not None and len(torque) > 3:
            jumps = np.diff(torque, 2)
            values.append(
                np.median(np.abs(jumps)) / 0.6745 / np.sqrt(6.0) / np.sqrt(max(WINDOW / run.period / 2.0, 1.0))
            )
    return float(np.median(values)) if values else 0.0


def _error(error: np.ndarray) -> Error:
    return Error(float(np.sqrt(np.mean(error**2))), float(np.mean(np.abs(error))))
