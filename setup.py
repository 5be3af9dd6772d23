"""Which folders make the import package ``sealegs``; all else about the project is in pyproject.toml."""

from setuptools import find_packages, setup

PARTS = ("envs", "actuators", "agents", "gap", "hw", "configs", "common")

setup(
    packages=[
        "sealegs",
        *(f"sealegs.{name}" for name in find_packages("library")),
        *(f"sealegs.{part}" for part in PARTS),
        *(f"sealegs.{part}.{name}" for part in PARTS for name in find_packages(part)),
    ],
    package_dir={"sealegs": "library", **{f"sealegs.{part}": part for part in PARTS}},
    package_data={"": ["py.typed", "*.yaml", "*/*.yaml", "*.npz", "*/*.npz", "*.j2", "*.css"]},
)
