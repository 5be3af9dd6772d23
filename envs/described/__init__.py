"""Robots that files describe: MJCF and URDF read, and completed by a YAML."""
