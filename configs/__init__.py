"""Configs: one folder per choice, one file per script, and the code that reads them."""
