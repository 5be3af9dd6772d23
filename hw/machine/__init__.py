"""A machine as the host sees it: which servo is which joint, where its zero is, how far and how fast it may go."""
