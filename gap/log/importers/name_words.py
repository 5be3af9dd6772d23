"""Words of names of columns: which say a signal, which say who it is of, which say nothing."""

from __future__ import annotations

import re

COMMANDED = frozenset(
    [
        "goal",
        "target",
        "desired",
        "des",
        "ref",
        "reference",
        "setpoint",
        "sp",
        "cmd",
        "command",
        "commanded",
        "con",
        "set",
        "action",
        "actions",
        "demand",
        "requested",
        "wanted",
        "soll",
        "sollwert",
        "sollwinkel",
        "sollposition",
        "commands",
        "goals",
        "targets",
        "setpoints",
        "references",
        "consigne",
        "consigna",
        "referencia",
        "planned",
        "interpolated",
        "ipo",
        "lowcmd",
    ]
)
PLANNED = frozenset(["planned", "interpolated", "ipo"])
"""Commanded, before a controller or a correction makes of it what is sent."""
MEASURED = frozenset(
    [
        "meas",
        "msr",
        "measured",
        "act",
        "actual",
        "present",
        "fb",
        "feedback",
        "ist",
        "istwert",
        "istwinkel",
        "istposition",
        "real",
        "observation",
        "state",
        "states",
        "sensor",
        "read",
        "est",
        "estimate",
        "estimated",
        "mesure",
        "medida",
        "misura",
        "applied",
        "lowstate",
    ]
)
WEAK = frozenset(["state", "states", "lowstate", "sensor", "observation", "applied"])
"""Measured, where nothing else of the name says that it was commanded."""
ALONE = frozenset(
    ["actual", "act", "measured", "meas", "feedback", "fb", "ist", "istwert", "mesure", "medida", "misura"]
)
"""A position, where they are the whole name."""
FILTERED = frozenset(["filt", "filtered", "smooth", "smoothed", "lp", "lowpass"])
DROPPED = frozenset(
    [
        "error",
        "err",
        "fric",
        "friction",
        "ff",
        "feedforward",
        "integral",
        "kp",
        "ki",
        "kd",
        "gain",
        "stiffness",
        "damping",
    ]
)
"""Parts of a controller or of a model: no signal of the log, whatever else the name says."""
TOOL = frozenset(["cartesian", "eef", "tcp", "ee", "effector", "endeffector"])
"""What stands at the end of an arm: its pose is of no joint."""
OF_JOINTS = frozenset(["joint", "joints", "motor", "motors", "servo", "servos", "axis", "gripper"])
"""Words beside which a word for the tool says where a joint is."""
FORWARD = frozenset(["ff", "feedforward"])
"""Those that make a torque a commanded one."""
MODELLED = "computed"
"""A torque that a controller computed, before a limit or a drive made something of it: simulators log it."""
STIFFNESS, DAMPING = ("kp", "stiffness"), ("kd", "damping")
"""Parts of a controller that are gains of an impedance drive."""
FILLERS = frozenset(
    [
        "observation",
        "observations",
        "obs",
        "data",
        "robot",
        "joints",
        "value",
        "values",
        "msg",
        "the",
        "of",
        "in",
        "per",
        "and",
        "input",
        "supply",
        "bus",
        "battery",
        "field",
        "header",
        "controller",
        "control",
        "dof",
        "dofs",
    ]
)
SIGNALS: tuple[tuple[str, frozenset[str]], ...] = (
    ("enabled", frozenset(["enable", "enabled"])),
    ("acceleration", frozenset(["acc", "accel", "acceleration", "ddq", "qdd", "qddot", "ddtheta", "jerk"])),
    ("velocity", frozenset(["vel", "velocity", "speed", "dq", "qdot", "qvel", "dtheta", "thetadot", "omega", "dpos",
                            "geschwindigkeit", "winkelgeschwindigkeit", "drehzahl", "velocities", "vitesse",
                            "velocidad", "velocita"])),
    ("temperature", frozenset(["temp", "temperature", "temperatur", "temper", "temperatura", "temperatures"])),
    ("voltage", frozenset(["volt", "volts", "voltage", "vin", "vbus", "ubat", "spannung"])),
    ("duty", frozenset(["duty", "pwm"])),
    ("torque", frozenset(["torque", "tau", "effort", "force", "trq", "moment", "drehmoment", "efforts", "torques",
                          "couple"])),
    ("position", frozenset(["pos", "position", "angle", "q", "theta", "phi", "qpos", "encoder", "enc", "positions",
                            "angles", "posicion", "posizione", "angulo", "angolo", "winkel", "sollwinkel",
                            "istwinkel", "sollposition", "istposition"])),
    ("current", frozenset(["current", "curr", "amps", "ampere", "iq", "strom", "currents", "courant", "corriente",
                           "corrente"])),
    ("load", frozenset(("load",))),
    ("time", frozenset(["time", "timestamp", "stamp", "t", "ts", "clock", "elapsed", "duration", "zeit", "temps",
                        "tiempo", "tempo"])),
)  # fmt: skip
"""Signals by the words that say them; the first one that a name has is its signal."""
SUPPLY = frozenset(["supply", "vsupply", "battery", "batt", "bat", "vbat", "vbatt", "vcc", "vdd", "psu", "versorgung"])
"""What a voltage is of; a name that says no other signal and no other unit means the voltage."""
VOLTS = SUPPLY | {"bus"}
"""Words beside which a v is a voltage."""
CLOCK_WORDS = frozenset(["ms", "seconds", "sec", "secs", "us", "ns", "millis", "micros"])
"""Units that are the whole name of a clock."""
ANGLE_WORDS = frozenset(["q", "theta", "phi", "angle", "winkel", "yaw", "pitch", "roll"])
"""Words of which none is a way: an ``m`` behind them is no metre."""
SHORT = re.compile(r"(q|theta|phi|x)(m|meas|msr|a|act|g|r|ref|d|des|c|cmd|goal)")
"""Signs of control theory: ``qm`` measured, ``qg`` goal, ``qd`` desired (or the derivative: the data tell)."""
RATES = frozenset(["qd", "xd", "thetad", "phid", "v", "w"])
"""Derivatives, beside a word that says that they are commanded."""
SIGNS = frozenset(["q", "dq", "qd", "qdot", "ddq", "qdd", "qddot", "theta", "dtheta", "thetad", "thetadot", "phi",
                   "phid", "omega", "tau"])  # fmt: skip
"""Signs of papers and of libfranka, behind which a ``d`` is the wanted one: ``q_d``, ``tau_J_d``."""
ONLY_UNIT = {"angle": "position", "rate": "velocity", "torque": "torque", "current": "current", "voltage": "voltage"}
"""Signals by the quantity of a unit, where a name says nothing else."""
