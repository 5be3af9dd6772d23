"""What moves: robots, their tasks, and the batch engine that steps them."""
