"""A new robot: its YAML written from its model file, and tried."""
