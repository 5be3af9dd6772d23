"""The series elastic hopper (paper 004): its experiments, and its printed figures beside ours."""
