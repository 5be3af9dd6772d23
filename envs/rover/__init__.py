"""A rover on two servos in wheel mode, as data: a model file and a YAML."""
