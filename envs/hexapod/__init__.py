"""The hexapod AMRU5 of paper 001."""
