"""The transfer study that docs/results/transfer.md reports: ``python -m benchmarks.transfer``, which goes on.

``sealegs transfer`` runs any other. Machines, seeds and steps were chosen before any result was seen; machines below
seed 900 are for development.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from sealegs.commands.transfer import main as transfer

from benchmarks.kept import RESULTS, study

FOLDER = Path("runs/transfer-reported")
REPORTED = ("robots=[bench,pan_tilt,leg]", "machines=2", "seeds=2", "seed=5900", "total_timesteps=64000")


def keep(folder: Path) -> None:
    """Copy what a study wrote to the results."""
    for name in ("transfer.json", "transfer.md"):
        shutil.copyfile(folder / name, RESULTS / name)
    for picture in folder.glob("*.png"):
        shutil.copyfile(picture, RESULTS / f"transfer_{picture.name}")


@study
def main() -> None:
    """Run the study, or go on with it."""
    transfer([*REPORTED, f"out={FOLDER}", *sys.argv[1:]])
    keep(FOLDER)


if __name__ == "__main__":
    sys.exit(main())
