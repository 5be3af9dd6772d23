"""Tasks that any robot has: follow joint trajectories, reach a pose; and those of a user's own file."""
