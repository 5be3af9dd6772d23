"""What is real: servos on a bus, their calibration, safety and control loop; and a virtual bus in place of them."""
