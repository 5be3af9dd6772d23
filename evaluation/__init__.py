"""What a policy earns in the models and on the machine, and where they depart."""
