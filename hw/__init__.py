"""What is real: servos on a bus, their calibration, safety and control loop; and a virtual bus that stands in for them."""
