"""What studies share: their command, rows that are kept as they are made, and pages of Markdown beside them."""

from __future__ import annotations

import argparse
import functools
import json
import multiprocessing
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from sealegs.common.errors import SealegsError

CHECKOUT = Path(__file__).resolve().parents[1]
RESULTS = CHECKOUT / "benchmarks" / "results"
DATA = CHECKOUT.parent / "shared" / "data"
"""Published recordings, where they are beside the checkout."""
POLICIES = CHECKOUT / "policies"
Row = dict[str, Any]


def study(main: Callable[[], int | None]) -> Callable[[], int]:
    """The main function of a script that measures.

    Returns:
        Its exit status: its own, else 0; 2 for wrong input, which is told in a sentence; 130 where it is stopped.
    """

    @functools.wraps(main)
    def run() -> int:
        try:
            return main() or 0
        except SealegsError as error:
            print(error, file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            print("Stopped; what is written stays, and rows that are done.", file=sys.stderr)
            return 130

    return run


def command(about: str | None) -> argparse.ArgumentParser:
    """The command line of the script that runs, whose help is what the script says of itself."""
    module = f"benchmarks.{Path(sys.argv[0]).stem}".removesuffix(".__main__")
    formatter = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(prog=f"python -m {module}", description=about, formatter_class=formatter)


class Kept:
    """Rows of a study in a file of JSON lines, each written as it is made: it can be stopped and goes on.

    Attributes:
        file: of the rows.
        rows: in the order in which they were made.
    """

    def __init__(self, file: Path, key: Callable[[Row], Any] = lambda row: row["key"]) -> None:
        """Read what is there.

        Args:
            file: for the rows; its folder is made.
            key: what a row is known by.
        """
        file.parent.mkdir(parents=True, exist_ok=True)
        lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
        self.file, self._key = file, key
        self.rows: list[Row] = [json.loads(line) for line in lines]

    def __contains__(self, key: object) -> bool:
        """Whether there is a row of that key."""
        return any(self._key(row) == key for row in self.rows)

    def add(self, row: Row) -> None:
        """Keep one more."""
        self.rows.append(row)
        with self.file.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")

    def run(self, one: Callable[[Any], Row], todo: Sequence[Any], said: Callable[[Row], str], jobs: int = 1) -> None:
        """Make and keep the rows of some cases, so many at a time, and print what is said of each."""
        for number, row in enumerate(side_by_side(one, todo, jobs), 1):
            self.add(row)
            print(f"{number}/{len(todo)} {self._key(row)}: {said(row)} ({row['seconds']:.0f} s)", flush=True)


def side_by_side(one: Callable[[Any], Row], todo: Sequence[Any], jobs: int) -> Iterable[Row]:
    """Results of cases in processes of their own, in whatever order; in this one where there is one at a time."""
    if jobs <= 1:
        yield from map(one, todo)
        return
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        yield from pool.imap_unordered(one, todo)


def read(name: str, empty: Any = None) -> Any:
    """What ``<name>.json`` of the results holds, or ``empty`` where there is none."""
    file = RESULTS / f"{name}.json"
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else empty


def write(name: str | Path, page: str | None = None, document: Any = None) -> None:
    """Write a page of results as ``<name>.md`` and what it is made of as ``<name>.json``, whichever is given.

    Args:
        name: in the results, or a path without its ending.
        page: Markdown.
        document: what JSON can hold.
    """
    file = RESULTS / name
    file.parent.mkdir(parents=True, exist_ok=True)
    if document is not None:
        file.with_name(f"{file.name}.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    if page is not None:
        file.with_name(f"{file.name}.md").write_text(page, encoding="utf-8")


def committed() -> list[str]:
    """The policies that come along, such as ``biped/seed0``: the first seed of all tasks, then the others."""
    names = (f"{path.parent.parent.name}/{path.parent.name}" for path in POLICIES.glob("*/*/policy.json"))
    return sorted(names, key=lambda name: (name.partition("/")[2], name))
