"""Every number of the hopper, with the place where it was printed; what the paper leaves open is marked assumed.

The paper is paper 004, "Practical Approach to Characterize Realistic Motor Dynamics for Robotic Simulation Independent
of the Use Case". Numbers of its servo and its spring stand in ``configs/actuator/sv1270tg.yaml``.
"""

from __future__ import annotations

from ..engine.numbers import Number

NUMBERS = {
    "total_mass": Number(0.587, "kg", "paper 004, IV-A: 0.562 kg and 4.5 % for the boom", 0.01),
    "upper_mass": Number(0.059, "kg", "paper 004, IV-A", 1e-4),
    "lower_mass": Number(0.038, "kg", "paper 004, IV-A", 1e-4),
    "hip_rest": Number(-0.61, "rad", "paper 004, IV-A: q0", -1.5, 1.5),
    "knee_rest": Number(0.61, "rad", "paper 004, IV-A: q0", -1.5, 1.5),
    "floor_friction": Number(1.0, "-", "paper 004, IV-C: mu"),
    "upper_length": Number(0.108, "m", "assumed: chosen by the search of benchmarks/hopper_open_parameters.py", 0.01),
    "lower_length": Number(0.092, "m", "assumed: chosen by the search of benchmarks/hopper_open_parameters.py", 0.01),
    "upper_centre": Number(
        0.5, "-", "assumed: uniform rod; distance of the centre of mass from the hip over length", 0.05, 0.95
    ),
    "lower_centre": Number(
        0.5, "-", "assumed: uniform rod; distance of the centre of mass from the knee over length", 0.05, 0.95
    ),
    "foot_radius": Number(0.01, "m", "assumed", 1e-3),
    "contact_time": Number(
        0.006, "s", "assumed: the foot sinks in by less than 2 mm; time constant of its contact", 1e-3, 1.0
    ),
}
GOAL_RANGE = (
    0.6  # [rad] about q0, assumed: 2.6 times the paper's largest goal, so that a learner may do more than the paper
)
