"""Draws what a report opens with, and photographs one: ``python -m docs.generate.report_pictures``.

Writes ``docs/pictures/first_look.png`` and ``docs/pictures/report.png`` from a diagnosis of a virtual bench that
hides friction and delay. Needs the package playwright and Chromium.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

import sealegs
from playwright.sync_api import sync_playwright
from sealegs.gap.virtual.bench import record

FOLDER = Path(__file__).resolve().parents[1] / "pictures"
HIDDEN = {"friction.load": 0.13, "delay.seconds": 0.015}
WIDTH, HEIGHT = 1280, 800


def photograph(page: Path, picture: Path) -> None:
    """The first screen of a page."""
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        tab = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        tab.goto(page.as_uri())
        tab.screenshot(path=picture)
        browser.close()


def main() -> None:
    """Measure, diagnose and draw."""
    with tempfile.TemporaryDirectory() as folder:
        record(Path(folder) / "bench", "sts3215", HIDDEN)
        written = sealegs.diagnose(Path(folder) / "bench").save(Path(folder) / "diagnosis", print)
        shutil.copy(written["pictures"] / "first_look.png", FOLDER)
        photograph(written["report"], FOLDER / "report.png")


if __name__ == "__main__":
    main()
