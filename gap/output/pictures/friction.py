"""Pictures of friction and load: what the motor gives and the load does not get, against what it depends on."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...load.tree import NEGLIGIBLE_SIZE
from ...measure.named import NamedCause
from ...replay.parameters import address
from .evidence import Balance, Evidence
from .style import (
    bins,
    cloud,
    draw_measured,
    draw_models,
    equal_counts,
    equal_widths,
    legend_above,
    limits,
    plot,
    styled,
)

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
