"""What everything stands on: documents that people give, read within bounds."""
