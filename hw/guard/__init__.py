"""What ends a run safely: limits, stops of people, and the process that outlives the control loop."""
