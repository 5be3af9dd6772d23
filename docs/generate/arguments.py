"""For the site's generator: environments are documented as they are at run time, with the table of their arguments."""

from __future__ import annotations

from typing import Any

import griffe


class RunTimeArguments(griffe.Extension):
    """Puts the docstrings that :class:`~sealegs.envs.engine.arguments.TaskShell` made in the place of the written."""

    def on_class(self, *, cls: griffe.Class, **kwargs: Any) -> None:
        """Take a class's docstring from the class itself where it has arguments of a task."""
        del kwargs
        if cls.docstring is not None and "## Arguments" in cls.docstring.value:
            cls.docstring.value = griffe.dynamic_import(cls.path).__doc__ or ""
