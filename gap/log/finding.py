"""What a check of a log has to say."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

MAX_TOLD = 4
"""Items of a list that are told or drawn; more are not read."""
Severity = Literal["error", "warning", "note"]


@dataclass(frozen=True)
class Finding:
    """One fact about a log that its reader should know.

    Attributes:
        code: stable identifier such as ``velocity.scale``.
        severity: ``error``: the log cannot be used as it is; ``warning``: a column must not be trusted as it is;
            ``note``: worth knowing.
        joint: joint concerned, None for the whole run.
        column: column concerned as named in the file, None for several.
        sentence: for people, with numbers and what to do.
        value: the number behind it in SI units, None where there is none.
        low, high: 95 % interval of ``value``, None where it was not estimated.
        cause: catalogue name of a cause that explains the finding, None where there is none.
        data_error: whether the log contradicts itself or its format, rather than the machine being at a limit.
        run: name of the run.
    """

    code: str
    severity: Severity
    joint: str | None
    column: str | None
    sentence: str
    value: float | None = None
    low: float | None = None
    high: float | None = None
    cause: str | None = None
    data_error: bool = False
    run: str | None = None

    @property
    def fault(self) -> tuple[str, str | None, str | None]:
        """Code, joint and column: what it is that is wrong, whichever run shows it."""
        return self.code, self.joint, self.column
