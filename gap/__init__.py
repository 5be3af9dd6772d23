"""What the simulation gets wrong: measured log, replay, causes, search, report."""
