"""What blocks the pendulum of a bench; alone in its file, since compiled replays depend on it."""

STOP_STIFFNESS, STOP_DAMPING = 500.0, 1.0  # [N.m/rad], [N.m.s/rad]: assumed
