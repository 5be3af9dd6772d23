"""Where things stand in a law's program and in its state: the one table that laws, packing and readers share.

A *program* is a flat array of doubles: the header below, then one record ``[opcode, length, memory offset,
parameters...]`` per stage that has a law, then a zero. It travels in ``actuator_user`` of the MuJoCo model, where
``Batch.expand`` can vary it per simulation.

A *state* is a flat array of doubles: the slots below, then the memory of the stages. It travels in ``mjData.userdata``.
"""

from __future__ import annotations

MAGIC = 5_315_417.0  # marks an actuator as ours; anything else is passed on to whoever owned the callback before

# program header
P_MAGIC = 0
P_LENGTH = 1  # doubles in the program
P_STATE_SIZE = 2
P_STATE_ADDRESS = 3  # in userdata
P_TERMS = 4  # joints that make up the driven coordinate: 1, or 2 for a belt over a joint
P_QPOS = 5  # two addresses
P_DOF = 7  # two addresses
P_COEFFICIENT = 9  # two coefficients
P_FRICTION_KIND = 11  # 0 native only, 1 law sets the limit of a joint's row, 2 of a tendon's row
P_FRICTION_ID = 12  # dof or tendon id of that row
P_TICKS = 13  # encoder ticks per turn, 0: not quantised
P_OFFSET = 14  # [rad]
P_SCALE = 15
P_LATENCY = 16  # [s]
P_LATENCY_MEMORY = 17  # offset of the encoder's ring in the state
P_VISCOUS = 18  # [N.m.s/rad], native damping; here for replays without an engine
P_OWN_FRICTION = 19  # dry friction that the model itself gives the joint [N.m], beside the law's
P_LOAD_STATE = 20  # state of the coordinate whose load presses on this one's transmission, in userdata
P_LOAD_FACTOR = 21  # that load by its contact torque, 0: the torque through the transmission itself counts
P_SUPPLY = 22  # where the resistance of a supply that others draw from, too, stands in the program; 0: none does
P_SUPPLY_NEXT = 23  # number of the next actuator that draws from it; the last one's next is the first
P_HEADER = 24

# state slots
S_TIME = 0  # start of the current physics step [s]
S_STAGE = 1  # Runge-Kutta stage of the current step, 0..3
S_READY = 2  # 0 until the memory is initialised
S_TORQUE = 3  # [N.m] on the driven coordinate, friction excluded
S_CURRENT = 4  # [A]
S_DUTY = 5
S_VOLTAGE = 6  # at the motor [V]
S_LIMIT = 7  # Coulomb friction limit in force [N.m]
S_OUT_OF_RANGE = 8  # actuator net samples whose inputs left the training range, since reset
S_GOAL = 9  # goal as the controller saw it [rad]
S_READING = 10  # encoder reading that the host receives [rad]
S_LOAD = 11  # external torque on the coordinate, complete where dry friction needs a law [N.m]
S_SPEED = 12  # [rad/s]
S_KNOWN = 13  # part of the load that mjData states as the law is called [N.m]
S_REST = 14  # its rest, from the accelerations of the latest evaluation [N.m]
S_ROW_INERTIA = 15  # resistance of the friction row to acceleration [kg.m2], 0: the engine's own
S_ROW_ACCELERATION = 16  # acceleration at which that row gives no torque [rad/s2]
S_PRESSED = 17  # load that presses on the transmission, where it is another coordinate's
S_STEP = 18  # physics step [s], 0 where no engine steps
S_DRAWN = 19  # current that the drive draws from a supply, as its step began [A]
S_BESIDE = 20  # and what others draw from it [A]
S_HEADER = 21

DELAY_EVENTS = 64  # goal changes remembered by a delay
LATENCY_SAMPLES = 32  # positions remembered by an encoder with latency
