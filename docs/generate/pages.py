"""Hooks of the site's generator: pages that lie elsewhere in the checkout and the links to them, and environments as
they are at run time."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

import griffe
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

CHECKOUT = Path(__file__).resolve().parents[2]
MEASURED = CHECKOUT / "benchmarks" / "results"
PROJECT = {"contributing.md": "CONTRIBUTING.md", "changelog.md": "CHANGELOG.md"}
"""Pages of the site by the file at the top of the checkout that they are."""
LINK = re.compile(r"(?<=\]\()(?!https?:|#)([^)\s#]+)(?=[)#])")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what the benchmarks wrote, and the pages of the project."""
    for path in sorted((*MEASURED.glob("*.md"), *MEASURED.glob("*.png"))):
        files.append(File.generated(config, f"results/{path.name}", abs_src_path=str(path)))
    for uri, name in PROJECT.items():
        files.append(File.generated(config, uri, abs_src_path=str(CHECKOUT / name)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links that hold in the checkout into those that hold in the site."""
    uri = page.file.src_uri
    home = posixpath.dirname(uri)
    # Folder of the source in the checkout, from which its links are meant.
    source = "benchmarks/results" if (MEASURED / posixpath.basename(uri)).is_file() and home == "results" else None
    folder = "" if uri in PROJECT else source or posixpath.join("docs", home)
    names = {name: uri for uri, name in PROJECT.items()}

    def moved(match: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(folder, match[1]))
        if target in names:
            target = names[target]
        elif target.startswith("benchmarks/results/"):
            target = target.replace("benchmarks/results/", "results/", 1)
        elif target.startswith("docs/"):
            target = target.removeprefix("docs/")
        else:
            return match[1]
        return posixpath.relpath(target, home or ".")

    return LINK.sub(moved, markdown)


class RunTimeArguments(griffe.Extension):
    """Puts the docstrings that :class:`~sealegs.envs.engine.arguments.TaskShell` made in the place of the written."""

    def on_class(self, *, cls: griffe.Class, **kwargs: Any) -> None:
        """Take a class's docstring from the class itself where it has arguments of a task."""
        del kwargs
        if cls.docstring is not None and "## Arguments" in cls.docstring.value:
            cls.docstring.value = griffe.dynamic_import(cls.path).__doc__ or ""
