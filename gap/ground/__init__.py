"""Contact causes of a legged log: what the ground is like, from free replays of the whole leg over its stances."""
