"""Pictures of the drive: how the joint answers, what the controller makes of an error, how supply and motor weaken."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ...measure.named import NamedCause
from ...search.structure import told_in
from ..numbers import LAYOUT
from .evidence import Evidence
from .style import (
    BOTH,
    EXTENDED,
    MEASURED,
    NOMINAL,
    bins,
    cloud,
    draw_measured,
    draw_model,
    draw_models,
    equal_counts,
    equal_widths,
    figure,
    filled,
    legend_above,
    limits,
    plot,
    styled,
)
from .timeline import timeline, worst_window

UNITS = {"speed": "rad/s", "control error": "rad", "motor torque": "N.m", "acceleration": "rad/s2", "position": "rad"}


@styled
def response(evidence: Evidence, cause: NamedCause) -> Figure:
    """A moment of the test part where the nominal model is most wrong, and the quantity that its error follows."""
    line = timeline(evidence.diagnosis)
    assert line is not None
    chart = figure(5.8, 5.8)
    over_time, against = chart.subplots(2, 1, height_ratios=(1.0, 1.0))
    start, stop = worst_window(line, LAYOUT.response)
    use = (line.x >= start - 0.02) & (line.x <= stop + 0.02)
    x = line.x[use] - start
    if line.goal is not None:
        over_time.plot(x, line.goal[use], color="#777777", lw=1.0, ls="--", drawstyle="steps-post", label="goal")
    over_time.plot(x, line.models["nominal"][use], color=NOMINAL, label="nominal model")
    over_time.plot(x, line.models["extended"][use], color=EXTENDED, label="extended model")
    over_time.plot(x, line.measured[use], ".", color=MEASURED, ms=2.6, label="measured")
    over_time.set_xlim(0.0, stop - start)
    over_time.set_xlabel("time in this moment of the test part [s]")
    over_time.set_ylabel(f"{line.quantity} [{line.unit}]")
    legend_above(over_time, 4)

    factor, unit = told_in(line.unit)
    what = cause.against
    values = _variable(evidence, what)
    rows = evidence.motion.judged & np.isfinite(values)
    edges = equal_counts(values[rows], 24)
    for name, colour in BOTH:
        error = factor * (evidence.problem.measured[:, 0] - evidence.diagnosis.simulated[name][:, 0])
        draw_model(against, bins(values[rows], error[rows], edges), None, colour)
    against.axhline(0.0, color=MEASURED, lw=0.9)
    if rows.any():
        against.set_xlim(*np.quantile(values[rows], (0.01, 0.99)))
    against.set_xlabel(f"{what} [{evidence.unit(UNITS[what])}]")
    against.set_ylabel(f"measured minus model [{unit}]")
    return chart


@styled
def duty_against_error(evidence: Evidence, cause: NamedCause) -> Figure:
    """What the controller makes of its error: measured points on the laws of both models."""
    motion, problem = evidence.motion, evidence.problem
    error = _variable(evidence, "control error")
    measured, nominal = evidence.extended, evidence.nominal
    duty = motion.duty is not None and measured.source in ("current", "duty")
    chart, axes = plot()
    if duty:
        logged = problem.measured[:, 2]
        models = (nominal.duty, measured.duty)
        rows = motion.judged & np.isfinite(logged)
        axes.set_ylabel("duty")
    else:
        logged = measured.inertial + measured.gravity + measured.modelled_friction
        models = (nominal.law, measured.law)
        rows = motion.moving
        axes.set_ylabel(f"motor {evidence.effort}")
    reach = _reach(cause, error[rows])
    rows &= np.abs(error) < reach
    cloud(axes, error[rows], logged[rows])
    edges = filled(error[rows], equal_widths(error[rows], 48))  # at full duty samples are few
    draw_models(axes, error[rows], (models[0][rows], models[1][rows]), edges)
    draw_measured(axes, bins(error[rows], logged[rows], edges), "measured")
    axes.set_xlim(-reach, reach)
    axes.set_ylim(*limits(logged[rows], 0.15))
    axes.set_xlabel(f"control error: goal as it arrives minus position [{evidence.unit('rad')}]")
    legend_above(axes)
    return chart


@styled
def voltage_against_current(evidence: Evidence, cause: NamedCause) -> Figure:
    """Voltage of the supply over the current that it gives."""
    motion, measured, nominal = evidence.motion, evidence.extended, evidence.nominal
    chart, axes = plot()
    duty = motion.duty if motion.duty is not None else measured.duty
    current = motion.current if motion.current is not None else measured.current
    drawn = np.maximum(duty * current, 0.0)
    use = motion.judged & (np.abs(duty) > 0.2)
    seen = _seen_voltage(evidence, duty, current)
    edges = equal_counts(drawn[use], 18)
    if seen is not None:
        cloud(axes, drawn[use], seen[use])
    for model, label, colour in ((nominal, "nominal model", NOMINAL), (measured, "extended model", EXTENDED)):
        supplied = model.voltage / np.where(np.abs(model.duty) > 1e-6, model.duty, np.nan)
        rows = use & np.isfinite(supplied)
        draw_model(axes, bins(drawn[rows], supplied[rows], edges), label, colour)
    if seen is not None:
        draw_measured(axes, bins(drawn[use], seen[use], edges), "measured: (R i + k ω) / duty")
        axes.set_ylim(*limits(seen[use], 0.1))
    axes.set_xlim(0.0, float(np.quantile(drawn[use], 0.998)) if use.any() else 1.0)
    axes.set_xlabel("current drawn from the supply: duty times motor current [A]")
    axes.set_ylabel("supply voltage [V]")
    legend_above(axes)
    return chart


@styled
def residual_against_temperature(evidence: Evidence, cause: NamedCause) -> Figure:
    """Torque that the motion needs over what the nominal motor gives at the same current (or duty), by temperature."""
    measured, nominal, motion = evidence.extended, evidence.nominal, evidence.motion
    needed = measured.inertial + measured.gravity + measured.modelled_friction
    strong = np.quantile(np.abs(nominal.motor[motion.moving]), 0.4) if motion.moving.any() else 0.0
    use = motion.moving & (np.abs(nominal.motor) > max(float(strong), 1e-9))
    warm = evidence.problem.temperature[use]
    ratio, model = (torque[use] / nominal.motor[use] for torque in (needed, measured.motor))
    edges = _degrees(warm)
    chart, axes = plot()
    cloud(axes, warm, ratio)
    axes.axhline(1.0, color=NOMINAL, label="nominal model")
    draw_model(axes, bins(warm, model, edges), "extended model", EXTENDED)
    seen = bins(warm, ratio, edges)
    draw_measured(axes, seen, "measured")
    axes.set_ylim(*limits(np.concatenate([seen.low, seen.high, [1.0]]), 0.4))
    axes.set_xlabel("temperature of the motor [degC]")
    axes.set_ylabel("torque / that of the nominal motor")
    legend_above(axes)
    return chart


def _degrees(warm: np.ndarray) -> np.ndarray:
    """Edges of bins of whole degrees, wider where the temperature moves far, as sensors round to degrees (b,)."""
    if not len(warm):
        return np.zeros(0)
    low, high = np.floor(warm.min()), np.ceil(warm.max())
    width = max(np.ceil((high - low) / 12.0), 1.0)
    return np.arange(low - 0.5, high + 0.5 + width, width)


def _seen_voltage(evidence: Evidence, duty: np.ndarray, current: np.ndarray) -> np.ndarray | None:
    """Supply voltage that current and speed demand [V], None where they were not logged."""
    if evidence.extended.source != "current" or evidence.motion.duty is None:
        return None
    seen = np.empty(len(duty))
    for k, unit in enumerate(evidence.problem.units):
        at = slice(evidence.problem.starts[k], evidence.problem.starts[k + 1])
        chain = evidence.problem.models[unit.run].with_fitted(evidence.diagnosis.values).chain
        motor = chain.find("dc_motor")
        at_motor = motor.resistance * current[at] + motor.back_emf * chain.gear_ratio() * evidence.extended.speed[at]
        seen[at] = at_motor / np.where(np.abs(duty[at]) > 1e-3, duty[at], 1e-3)
    return seen


def _variable(evidence: Evidence, what: str) -> np.ndarray:
    """A quantity that errors may follow, per sample (n,)."""
    motion = evidence.motion
    if what == "control error":
        return _arriving_goal(evidence) - evidence.problem.measured[:, 0]
    if what == "motor torque":
        return evidence.extended.motor
    return {"speed": motion.speed, "acceleration": motion.acceleration, "position": motion.position}[what]


def _arriving_goal(evidence: Evidence) -> np.ndarray:
    """Goal as it arrives behind the extended model's delay, offset and scale (n,) [rad]."""
    problem = evidence.problem
    goal = np.empty(len(problem.goal))
    for k, unit in enumerate(problem.units):
        at = slice(problem.starts[k], problem.starts[k + 1])
        joint = problem.models[unit.run].with_fitted(evidence.diagnosis.values)
        chain, time = joint.chain, problem.time[at]
        late = delay.seconds if (delay := chain.find("delay")) is not None else 0.0
        held = np.clip(np.searchsorted(time, time - late, side="right") - 1, 0, len(time) - 1)
        shift = stage.value if (stage := chain.find("offset")) is not None else 0.0
        goal[at] = problem.goal[at][held] + shift
    return goal


def _reach(cause: NamedCause, error: np.ndarray) -> float:
    """Half the span of errors to show [rad]: near zero for what acts there, all of it for a saturation."""
    whole = float(np.quantile(np.abs(error), 0.998)) if len(error) else 1.0
    band = cause.parameters.get("dead_band.width")
    if band is not None and band.value > 0.0:
        return min(whole, max(4.0 * band.value, 0.02))
    if "minimum_duty.value" in cause.parameters:
        return min(whole, float(np.quantile(np.abs(error), 0.6)) if len(error) else 1.0)
    return whole
