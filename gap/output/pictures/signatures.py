"""Pictures of the features that a cause must bring to where they were measured."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from ...measure.named import NamedCause
from ...measure.signatures import SIGNATURE_LIMITS, Signature
from ...verdict.verdict import JointDiagnosis
from .style import EXTENDED, NOMINAL, figure, styled


def signature_pictures(diagnosis: JointDiagnosis) -> Iterator[tuple[str, Figure]]:
    """One picture per cause that has features, by the cause's name and ``.signature``."""
    for cause in diagnosis.causes:
        if cause.signatures:
            yield f"{cause.name}.signature", features(cause)


@styled
def features(cause: NamedCause) -> Figure:
    """How far each feature of the models is from what was measured; a cause that is right brings it to zero."""
    seen = cause.signatures
    chart = figure(6.4, 1.1 + 0.75 * len(seen))
    for axes, signature in zip(np.atleast_1d(chart.subplots(len(seen), 1)), seen, strict=True):
        rows = ((1.0, signature.nominal, signature.nominal_error, NOMINAL, "nominal model, tuned"),
                (0.0, signature.extended, signature.extended_error, EXTENDED, f"with {cause.name}"))  # fmt: skip
        for height, value, error, colour, label in rows:
            axes.errorbar(
                1e3 * value,
                height,
                xerr=1e3 * SIGNATURE_LIMITS.sure * error,
                fmt="o",
                color=colour,
                label=label,
                capsize=3,
                lw=1.4,
            )
        axes.axvline(0.0, color="0.4", lw=0.8)
        axes.set_ylim(-0.6, 1.6)
        axes.set_yticks([])
        axes.set_title(f"{signature.name}: {signature.verdict}", fontsize=9, loc="left")
        axes.set_xlabel(f"measured minus model [m{signature.unit}]", fontsize=8)
    chart.axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize=8, frameon=False)
    return chart


def told(seen: Signature) -> str:
    """A feature in words."""
    unit = f"m{seen.unit}"
    return f"{seen.name}: {1e3 * seen.nominal:+.2g} to {1e3 * seen.extended:+.2g} {unit} off ({seen.verdict})"
