"""How much of a diagnosis is shown at once: lines of a terminal, samples of a plot, rows of a picture.

Nothing is decided by these numbers; they were chosen by eye.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Layout:
    """Bounds of what a person sees.

    Attributes:
        narrowest: columns of a terminal below which lines are allowed to run over.
        widest: longer lines are hard to read.
        page_samples: of a zoomable plot over all joints; keeps the page small enough to send.
        plot_samples: of one joint, at least.
        moment: that is shown of a log [s], where it is not slow.
        moment_samples: of it, at least.
        response: that is shown of a joint's answer [s].
        pause: drawn between runs [s].
        bin_samples: in a bin, at least.
        causes: with a row of their own.
        candidates: of a round.
        bar: height of one, in rows.
        wide, tall, alone: sizes of a report's first picture [inch].
    """

    narrowest: int = 40
    widest: int = 100
    page_samples: int = 16_000
    plot_samples: int = 2_000
    moment: float = 1.2
    moment_samples: int = 80
    response: float = 0.4
    pause: float = 0.5
    bin_samples: int = 12
    causes: int = 5
    candidates: int = 7
    bar: float = 0.66
    wide: tuple[float, float] = (11.0, 3.5)
    tall: tuple[float, float] = (5.2, 6.6)
    alone: tuple[float, float] = (6.0, 2.6)


LAYOUT = Layout()
