"""The transfer studies that docs/results/transfer.md reports: ``python -m benchmarks.transfer``, which goes on.

``python -m benchmarks.transfer transfer_eight`` does the second alone: more machines, fewer treatments. ``sealegs
transfer`` runs any other. Machines, seeds and steps were chosen before any result was seen, but for three of the eight
machines, which are those of the first study. Machines below seed 900 are for development.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

from sealegs.commands.transfer import main as transfer

from benchmarks.kept import RESULTS, command, study

EVERY = ("seed=5900", "total_timesteps=64000")
STUDIES = {
    "transfer": ("robots=[bench,pan_tilt,leg]", "machines=2", "seeds=2", *EVERY),
    "transfer_eight": (
        "robots=[bench,pan_tilt]", "machines=4", "seeds=1", *EVERY,
        "treatments=[nominal, hand-made randomisation, extended, limit]",
    ),
}  # fmt: skip


def keep(folder: Path, name: str) -> None:
    """Copy what a study wrote to the results."""
    for ending in ("json", "md"):
        shutil.copyfile(folder / f"transfer.{ending}", RESULTS / f"{name}.{ending}")
    for picture in folder.glob("*.png"):
        shutil.copyfile(picture, RESULTS / f"{name}_{picture.name}")


@study
def main() -> None:
    """Run the studies, or go on with them."""
    parser = command(__doc__)
    parser.add_argument("studies", nargs="*", help=f"of {', '.join(STUDIES)}; default: all")
    names = parser.parse_args().studies or [*STUDIES]
    if unknown := [name for name in names if name not in STUDIES]:
        parser.error(f"there is no study '{unknown[0]}'; there are {', '.join(STUDIES)}")
    for name in names:
        folder = Path(f"runs/{name.replace('_', '-')}-reported")
        transfer([*STUDIES[name], f"out={folder}"])
        keep(folder, name)


if __name__ == "__main__":
    sys.exit(main())
