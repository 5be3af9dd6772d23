"""The import package ``sealegs`` is the top of this checkout; all else about the project is in pyproject.toml."""

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

PARTS = ("actuators", "agents", "commands", "common", "configs", "envs", "evaluation", "gap", "hw")


class BuildPackage(build_py):
    """Leaves the scripts out that lie beside the package's own ``__init__.py`` and ``__main__.py``."""

    def find_package_modules(self, package: str, package_dir: str) -> list[tuple[str, str, str]]:
        found = super().find_package_modules(package, package_dir)
        return [row for row in found if package != "sealegs" or row[1].startswith("__")]


FOLDERS = find_packages(".", include=[*PARTS, *(f"{part}.*" for part in PARTS)])

setup(
    packages=["sealegs", *(f"sealegs.{folder}" for folder in FOLDERS)],
    package_dir={"sealegs": "."},
    package_data={
        "": ["*.yaml", "*.xml", "*.npz", "*.j2", "*.css"],
        "sealegs": ["py.typed"],
        "sealegs.configs": ["*/*.yaml", "*/*.npz"],  # folders of choices, which are no packages
    },
    cmdclass={"build_py": BuildPackage},
)
