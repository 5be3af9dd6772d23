"""A quadruped of twelve hobby servos, as data: a model file and a YAML."""
