"""Pictures of a driven replay: what passes between a motor and a link that moves as it was measured."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from ...checks.signal import derivatives
from ...measure.named import NamedCause
from ...replay.constants import K
from ...replay.joint_model import JointModel
from ...replay.simulator import coupling_torque
from .binned import bins, cloud, draw_measured, equal_counts, limits
from .evidence import Evidence
from .style import EXTENDED, NOMINAL, figure, legend_above, styled


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
    chart = figure()
    axes = chart.subplots()
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
