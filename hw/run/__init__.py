"""One run: where goals come from, the control loop, its pace, and the log that it leaves."""
