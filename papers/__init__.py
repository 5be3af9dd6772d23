"""What repeats the published systems: their experiments, printed figures beside ours. Not part of the wheel."""
