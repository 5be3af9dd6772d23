"""Whether a policy pays: the same recipe trained on several models of a machine, all judged on the machine."""
