"""Stretches in which a drive looks switched off, though no ``enabled`` column says so.

A drive that is on answers an error of position. Where the duty stays at zero while the goal is further away
than where the same machine works elsewhere, the motor was released. Replayed as if it were on, such a stretch is
hundreds of mrad of error that no cause of the drive explains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..log.finding import Finding
from ..log.parts import stretches
from ..log.types import MeasuredSet
from .context import JointContext, joint_contexts

MIN_OFF_SECONDS = 0.3  # [s] a drive that is on may do nothing for a while: a dead band, a reversal
NO_EFFORT_SHARE = 0.01  # of the largest effort of the machine, up to which an effort is none
OFF_ERROR_RATIO = 1.5  # times the error at which the drive typically works, from which one that does nothing is off
FAR_GOAL_SHARE = 0.3  # of a stretch without effort in which the goal must be that far away


def released(data: MeasuredSet) -> tuple[MeasuredSet, list[Finding]]:
    """The runs with an ``enabled`` column for each joint whose drive looks off somewhere, and what is said about it."""
    findings: list[Finding] = []
    for name in dict.fromkeys(joint for run in data.runs for joint in run.joints):
        contexts = {
            k: joint
            for k, run in enumerate(data.runs)
            for joint in joint_contexts(run)
            if joint.name == name and len(joint.time) == len(run.time)  # excerpts of long logs come as windows
        }
        masks = dict(zip(contexts, looks_off(list(contexts.values())), strict=True))
        runs = list(data.runs)
        for k, off in masks.items():
            if off is None or not off.any():
                continue
            run, log = runs[k], runs[k].joints[name]
            findings.append(_finding(contexts[k], off))
            runs[k] = replace(run, joints={**run.joints, name: replace(log, enabled=np.where(off, 0.0, 1.0))})
        data = replace(data, runs=tuple(runs))
    return data, findings


def _finding(joint: JointContext, off: np.ndarray) -> Finding:
    first, last = joint.time[off][[0, -1]]
    return Finding(
        "drive.looks_off", "warning", joint.name, joint.column("enabled"),
        f"The drive of {joint.name} looks off in {off.mean():.0%} of the samples, {first:.3g} to {last:.3g} s: the "
        f"duty stays at zero while the goal is away. It is taken as off there; log {joint.column('enabled')}.",
        value=float(off.mean()), run=joint.run.name,
    )  # fmt: skip


def looks_off(joints: Sequence[JointContext]) -> list[np.ndarray | None]:
    """Samples (n,) at which the drive looks off in each run of one joint; None where that cannot be told.

    What is usual is judged over all runs: one of them may be off throughout.
    """
    efforts = [_effort(joint) for joint in joints]
    known = [k for k, effort in enumerate(efforts) if effort is not None]
    if not known:
        return [None] * len(joints)
    largest = max(float(np.nanmax(np.abs(effort), initial=0.0)) for effort in efforts if effort is not None)
    found: list[np.ndarray | None] = [None] * len(joints)
    away, idle = {}, {}
    for k in known:
        goal, effort = joints[k].log.goal, efforts[k]
        if goal is None or effort is None:
            continue
        away[k] = np.abs(goal - joints[k].log.position)
        idle[k] = np.abs(np.nan_to_num(effort, nan=np.inf)) <= NO_EFFORT_SHARE * largest
    if not away or largest == 0.0:
        return found
    working = np.concatenate([away[k][~idle[k]] for k in away])
    if len(working) < 100:
        return found
    far = OFF_ERROR_RATIO * float(np.median(working))
    for k in away:
        found[k] = _stretches(joints[k].time, idle[k], away[k] > far)
    return found


def _effort(joint: JointContext) -> np.ndarray | None:
    """What the drive does; None where that is not logged, or where a column says when it is on."""
    if joint.log.enabled is not None or joint.log.goal is None or joint.still:
        return None
    return joint.log.duty


def _stretches(time: np.ndarray, idle: np.ndarray, far: np.ndarray) -> np.ndarray:
    """Samples (n,) of the long stretches without effort in which the goal is mostly far away."""
    off = np.zeros(len(time), bool)
    for a, b in stretches(idle):
        if time[b - 1] - time[a] >= MIN_OFF_SECONDS and far[a:b].mean() > FAR_GOAL_SHARE:
            off[a:b] = True
    return off
