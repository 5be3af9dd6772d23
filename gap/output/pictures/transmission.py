"""Pictures of what lies between motor and link: how far it gives way under torque, forth and back."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...checks.signal import derivatives
from ...load.tree import NEGLIGIBLE_SIZE
from ...measure.named import NamedCause
from ...replay.constants import K
from ...replay.joint_model import JointModel
from ...replay.parameters import address
from ...replay.simulator import coupling_torque
from .evidence import Balance, Evidence
from .style import (
    BOTH,
    EXTENDED,
    NOMINAL,
    bins,
    cloud,
    draw_measured,
    draw_model,
    draw_models,
    equal_counts,
    equal_widths,
    figure,
    legend_above,
    limits,
    plot,
    styled,
)

FORWARD, BACKWARD = ">", "<"


@styled
def hysteresis(evidence: Evidence, cause: NamedCause) -> Figure:
    """What gives way, and what that does to the models' errors.

    Twist over torque where the link was logged, else error over the torque of the link by direction of motion.
    """
    measured = evidence.problem.measured
    if np.isfinite(measured[:, 1]).mean() > 0.95:
        return _twist(evidence)
    return _error_loop(evidence)


def _twist(evidence: Evidence) -> Figure:
    measured, simulated = evidence.problem.measured, evidence.diagnosis.simulated
    torque = evidence.extended.gravity + _link_share(evidence) * evidence.extended.inertial
    use = evidence.motion.judged
    twist = 1e3 * (measured[:, 0] - measured[:, 1])
    edges = equal_counts(torque[use], 24)
    chart, axes = plot()
    cloud(axes, torque[use], twist[use])
    for name, colour in BOTH:
        model = 1e3 * (simulated[name][:, 0] - simulated[name][:, 1])
        draw_model(axes, bins(torque[use], model[use], edges), f"{name} model", colour)
    draw_measured(axes, bins(torque[use], twist[use], edges), "measured")
    axes.set_ylim(*limits(twist[use]))
    axes.set_xlabel(f"what the link takes: {evidence.effort}")
    axes.set_ylabel(f"motor minus link position [m{evidence.unit('rad')}]")
    legend_above(axes)
    return chart


def _link_share(evidence: Evidence) -> float:
    """Inertia of the link as a share of the joint's."""
    model, params = evidence.problem.models[0], evidence.problem.params[0]
    link = model.load.inertia(params)
    return link / (link + model.chain.armature())


def _error_loop(evidence: Evidence) -> Figure:
    simulated, measured = evidence.diagnosis.simulated, evidence.problem.measured[:, 0]
    torque = evidence.extended.gravity + _link_share(evidence) * evidence.extended.inertial
    chart = figure(5.8, 4.4)
    panels = chart.subplots(1, 2, sharey=True)
    errors = []
    for axes, (name, colour) in zip(panels, BOTH, strict=True):
        error = 1e3 * (measured - simulated[name][:, 0])
        for way, marker, dash in ((1.0, FORWARD, "-"), (-1.0, BACKWARD, "--")):
            use = evidence.motion.moving & (way * evidence.motion.speed > 0.0)
            b = bins(torque[use], error[use], equal_counts(torque[use], 18))
            axes.plot(
                b.x, b.median, color=colour, ls=dash, marker=marker, ms=5, label=f"moving {'up' if way > 0 else 'down'}"
            )
            axes.fill_between(b.x, b.low, b.high, color=colour, alpha=0.15, lw=0.0)
            errors.append(np.concatenate([b.low, b.high]))
        axes.axhline(0.0, color="#777777", lw=0.7)
        axes.set_xlabel(f"what the link takes: {evidence.effort}")
        legend_above(axes, 2)
        axes.set_title(f"{name} model", y=1.09)
    panels[0].set_ylabel(f"measured minus model [m{evidence.unit('rad')}]")
    panels[0].set_ylim(*limits(np.concatenate(errors), 0.1))
    return chart


@styled
def error_since_reversal(evidence: Evidence, cause: NamedCause) -> Figure:
    """Error over the way since the joint last turned around: where it sticks, and gives way while it does."""
    problem, motion = evidence.problem, evidence.motion
    way, direction = np.zeros(len(problem.time)), np.zeros(len(problem.time))
    for a, b in zip(problem.starts[:-1], problem.starts[1:], strict=True):
        way[a:b], direction[a:b] = way_since_reversal(motion.position[a:b], 3.0 * problem.noise)
    use = motion.judged & (direction != 0.0)
    edges = equal_counts(1e3 * way[use], 24)
    chart, axes = plot()
    for name, colour in BOTH:
        error = 1e3 * direction * (problem.measured[:, 0] - evidence.diagnosis.simulated[name][:, 0])
        draw_model(axes, bins(1e3 * way[use], error[use], edges), f"{name} model", colour)
    axes.axhline(0.0, color="#000000", lw=0.9)
    axes.set_xlabel(f"way since the last reversal [m{evidence.unit('rad')}]")
    axes.set_ylabel(f"measured minus model, along the way [m{evidence.unit('rad')}]")
    axes.set_xscale("symlog", linthresh=10.0)
    axes.set_xlim(0.0)
    legend_above(axes)
    return chart


def way_since_reversal(position: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray]:
    """Way since the last reversal of more than ``least`` [rad] (n,), and direction, 0 before any motion (n,)."""
    way, direction = np.zeros(len(position)), np.zeros(len(position))
    if not len(position):
        return way, direction
    turn = extreme = float(position[0])
    sign = 0.0
    for k, x in enumerate(position):
        if sign == 0.0 and abs(x - turn) > least:
            sign, extreme = float(np.sign(x - turn)), float(x)
        elif sign * (x - extreme) > 0.0:
            extreme = float(x)
        elif sign * (extreme - x) > least:
            turn, extreme, sign = extreme, float(x), -sign
        way[k], direction[k] = abs(x - turn), sign
    return way, direction


# --- pictures of a driven replay: what passes between a motor and a link that moves as it was measured ---------------


@styled
def passed_torque(evidence: Evidence, cause: NamedCause) -> Figure:
    """Torque that the motor passes on, over the twist between motor and measured link: the spring and its play.

    The torque is the motor's by its measured current (by the model's where there is none), less what friction and its
    own inertia take.

    Args:
        evidence: of a joint whose link moves as measured.
        cause: that it shows; every one of its spring looks the same.
    """
    del cause
    problem, diagnosis = evidence.problem, evidence.diagnosis
    link = problem.link
    if link is None:
        raise ValueError("a link that is simulated has no measured twist to draw")
    use = problem.judged & np.isfinite(problem.measured[:, 0])
    twist = problem.measured[:, 0] - link[:, 0]
    torque = _torque(evidence, link)
    chart, axes = plot()
    cloud(axes, 1e3 * twist[use], torque[use])
    draw_measured(axes, bins(1e3 * twist[use], torque[use], equal_counts(1e3 * twist[use], 24)), "measured")
    least, most = np.quantile(twist[use], (0.002, 0.998))
    grid = np.linspace(least, most, 200)
    for name, values, colour in (("nominal", {}, NOMINAL), ("extended", diagnosis.values, EXTENDED)):
        axes.plot(1e3 * grid, _law(problem.models[0].with_fitted(values), grid), color=colour, label=f"{name} model")
    axes.set_ylim(*limits(torque[use]))
    axes.set_xlabel("motor minus link position [mrad]")
    axes.set_ylabel("torque passed on by the motor [N.m]")
    legend_above(axes)
    return chart


def _law(joint: JointModel, twist: np.ndarray) -> np.ndarray:
    """Torque of spring and play over a twist at rest [N.m]."""
    k = joint.constants({}, joint.chain.program())
    return np.array([coupling_torque(k, one, 0.0) for one in twist])


def _torque(evidence: Evidence, link: np.ndarray) -> np.ndarray:
    """Torque through the spring without that of its damper (n,) [N.m], smoothed over some samples."""
    problem, extended = evidence.problem, evidence.extended
    joint = problem.models[0].with_fitted(evidence.diagnosis.values)
    k = joint.constants({}, joint.chain.program())
    out = np.zeros(len(problem.time))
    for a, b in zip(problem.starts[:-1], problem.starts[1:], strict=True):
        _, speed, acceleration = derivatives(problem.time[a:b], problem.measured[a:b, 0])
        rate = speed - link[a:b, 1]
        if k[K.half_play] > 0.0:  # teeth damp where they touch
            twist = problem.measured[a:b, 0] - link[a:b, 0]
            rate = np.where(np.abs(twist) > k[K.half_play], rate, 0.0)
        friction = np.sign(speed) * extended.limit[a:b] + extended.viscous[a:b]
        taken = joint.chain.armature() * acceleration + friction + k[K.damping] * rate
        out[a:b] = extended.motor[a:b] - taken
    return out


# --- pictures of friction and load: what the motor gives and the load does not get, against what it depends on -------

SOURCES = {
    "current": "motor torque from the logged current",
    "duty": "motor torque from the logged duty",
    "law": "motor torque from the extended model, as neither current nor duty was logged",
}


@styled
def friction_against_speed(evidence: Evidence, cause: NamedCause) -> Figure:
    """Friction torque over speed, both directions."""
    measured, nominal = evidence.extended, evidence.nominal
    use = evidence.motion.moving
    chart, axes = plot()
    speed = measured.speed[use]
    friction = measured.observed_friction[use]
    cloud(axes, speed, friction)
    for side in (-1.0, 1.0):
        half, told = side * speed > 0.0, side < 0.0
        edges = equal_counts(speed[half], 16)
        models = nominal.modelled_friction[use][half], measured.modelled_friction[use][half]
        draw_models(axes, speed[half], models, edges, told=told)
        draw_measured(axes, bins(speed[half], friction[half], edges), "measured" if told else None)
    axes.axhline(0.0, color="#777777", lw=0.7)
    axes.axvline(0.0, color="#777777", lw=0.7)
    if len(speed):
        axes.set_xlim(*np.quantile(speed, (0.004, 0.996)))
    axes.set_ylim(*limits(friction))
    axes.set_xlabel(f"speed [{evidence.unit('rad/s')}]")
    axes.set_ylabel(f"friction {evidence.effort}")
    return _finish(chart, axes, measured)


@styled
def residual_against_load(evidence: Evidence, cause: NamedCause) -> Figure:
    """Dry friction over the torque that passes through the gearbox."""
    measured, nominal = evidence.extended, evidence.nominal
    use = evidence.motion.moving
    chart, axes = plot()
    load, dry = measured.load[use], _dry(measured)[use]
    cloud(axes, load, dry)
    edges = equal_counts(load, 16)
    draw_models(axes, load, (nominal.limit[use], measured.limit[use]), edges)
    draw_measured(axes, bins(load, dry, edges), "measured")
    axes.set_xlim(0.0, float(np.quantile(load, 0.998)) if len(load) else 1.0)
    low, high = limits(dry)
    axes.set_ylim(min(low, 0.0), high)
    axes.set_xlabel(f"through the gearbox: {evidence.effort}")
    axes.set_ylabel(f"dry friction {evidence.effort}")
    return _finish(chart, axes, measured)


@styled
def residual_against_position(evidence: Evidence, cause: NamedCause) -> Figure:
    """Over the angle: dry friction for a friction cause, else the torque that holds the load against its weight.

    The latter as a share of the nominal weight at a quarter turn, so that runs with different loads lie on one curve;
    of a joint that carries no weight, such as a level slide, as it is.
    """
    axis = evidence.problem.models[0].axis
    measured, nominal, motion = evidence.extended, evidence.nominal, evidence.motion
    use = motion.moving
    reading = motion.position[use]
    edges = equal_widths(reading, 32)
    chart, axes = plot()
    if any(address(path).owner == "friction" for path in cause.parameters):
        seen, models = _dry(measured), (nominal.limit, measured.limit)
        axes.set_ylabel(f"dry friction {evidence.effort}")
    else:
        weight = evidence.quarter_turn_torque
        carries = bool((weight > NEGLIGIBLE_SIZE).all())
        unit = weight if carries else np.ones_like(weight)
        seen = (measured.motor - measured.inertial - measured.modelled_friction) / unit
        models = (nominal.gravity / unit, measured.gravity / unit)
        plain = f"what the load takes, held still [{axis.unit('N.m')}]"
        axes.set_ylabel("torque of the weight / nominal at a quarter turn" if carries else plain)
    cloud(axes, reading, seen[use])
    draw_models(axes, reading, (models[0][use], models[1][use]), edges)
    draw_measured(axes, bins(reading, seen[use], edges), "measured")
    axes.set_ylim(*limits(seen[use]))
    axes.set_xlabel(f"position reading [{axis.unit('rad')}]")
    return _finish(chart, axes, measured)


def _dry(measured: Balance) -> np.ndarray:
    """Measured friction without its viscous part, counted against the motion (n,)."""
    return np.sign(measured.speed) * (measured.observed_friction - measured.viscous)


def _finish(chart: Figure, axes: Axes, measured: Balance) -> Figure:
    legend_above(axes)
    chart.supxlabel(
        f"Dots: medians with quartiles over moving samples;\n{SOURCES[measured.source]}.", fontsize=7.5, color="#555555"
    )
    return chart
