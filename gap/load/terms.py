"""What a joint of a robot works against while all other joints move as measured: columns of its terms.

A row of the terms holds, at one sample, the joint's position and speed as measured and then six blocks of the same
six: of all that hangs behind the joint, per kilogram of a payload at the end of the robot, per metre by which the
centre of mass of the joint's own body lies further from the joint, per square of that, per kg.m2 that this body has
more about the joint's axis, and of springs and weight compensation that the robot's file has. The replay adds the
blocks up with the numbers of :mod:`sealegs.gap.replay.constants`, so that a fit may turn those without MuJoCo
(:mod:`sealegs.gap.load.tree` makes the rows). The last columns are what the drives of all other joints draw from the
supply at its full voltage, and how much less of it for each volt that this sags by.
"""

from __future__ import annotations

# of a row, and of what a replay has at hand at one time
(
    E_POSITION,  # measured [rad], around which the rest holds
    E_SPEED,  # measured [rad/s]
    E_INERTIA,  # of the joint with all others held [kg.m2]
    E_BIAS,  # torque that the measured motion of the others needs of this one, itself not accelerated [N.m]
    E_SLOPE,  # its change with the own position [N.m/rad]
    E_CURVE,  # second change with it [N.m/rad2]
    E_DRAG,  # change with the own speed [N.m.s/rad]
    E_COUPLING,  # part of the bias that accelerations of the others make [N.m]: no load to the laws of a chain
    E_SIZE,
) = range(9)

T_OWN = E_INERTIA  # where the first block starts
T_SIZE = E_SIZE - T_OWN  # columns of a block
# blocks: all that hangs behind the joint, a payload, the centre of mass of its own body and the square of its way
(
    T_ALL,
    T_PAYLOAD,
    T_CENTRE,
    T_CENTRE_SQUARED,
    T_SPIN,  # the inertia of the joint's own body
    T_PASSIVE,  # springs and the like
    T_BLOCKS,
) = range(7)
T_DRAWN = T_OWN + T_BLOCKS * T_SIZE  # columns of what other joints draw [A], and of what a sag takes of it [A/V]
T_COLUMNS = T_DRAWN + 2
