"""Draws each cause of the catalogue as a report does: ``python -m docs.generate.cause_pictures [name ...]``.

A hidden bench (:mod:`testbed`) hides the effect, clearly, or a hidden hopper that of the ground; the log is diagnosed
with that cause alone in the catalogue; its picture goes into ``docs/pictures/causes``. Takes a quarter of a minute a
cause; pictures that are there are kept, unless they are named.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path

from PIL import Image
from sealegs.gap.causes.cause import GROUND
from sealegs.gap.finder.diagnosis import diagnose
from sealegs.gap.output.pictures import cause_pictures, png

from testbed import EFFECTS, hidden_bench, hidden_hopper

FOLDER = Path(__file__).resolve().parents[1] / "pictures" / "causes"
LOADS = ("light", "medium", "heavy")
WIDTH = 640  # [px]
COLOURS = 48
SECONDS = 10.0  # of each of the three runs
SEED = 7
SIZES = {"drive.saturation": 0.8}
"""Sizes of effects whose clear one does not show in runs as short as these."""


def picture(name: str) -> Image.Image | None:
    """The picture of a cause from a machine that hides it; None where the finder did not name it."""
    if name in GROUND:
        data, _ = hidden_hopper({name: "clear"}, SEED)
    else:
        data, _ = hidden_bench({name: SIZES.get(name, "clear")}, SEED, LOADS, duration=SECONDS)
    for drawn, chart in (drawn for found in diagnose(data, causes=[name]) for drawn in cause_pictures(found)):
        if drawn == name:
            image = Image.open(io.BytesIO(png(chart))).convert("RGB")
            small = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
            return small.quantize(COLOURS)
    return None


def main(names: list[str]) -> None:
    """Draw the pictures that are missing, or those of the causes that are named."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in names or [*EFFECTS, *GROUND]:
        path = FOLDER / f"{name}.png"
        if path.exists() and not names:
            continue
        if (image := picture(name)) is None:
            print(f"{name}: not named, no picture")
            continue
        image.save(path, optimize=True)
        print(f"{name}: {path.stat().st_size / 1024:.0f} KiB", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
