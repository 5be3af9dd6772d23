"""What actuators of a model file drive."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ModelDrive:
    """What actuators of the file make of a joint or of a tendon over two joints.

    Attributes:
        name: of the joint, or of the tendon.
        terms: joints and coefficients whose sum is driven.
        stiffness, damping: of a position servo, at the driven coordinate; 0 where the file has none.
        force: its largest force [N.m or N]; None: any.
        actuators: names of the file's actuators that it stands for.
    """

    name: str
    terms: tuple[tuple[str, float], ...]
    stiffness: float = 0.0
    damping: float = 0.0
    force: float | None = None
    actuators: tuple[str, ...] = ()
