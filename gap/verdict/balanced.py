"""The verdict of a joint whose torque alone was judged, and not its motion."""

from __future__ import annotations

import math

from ..checks.torque_balance import MAX_SHIFT
from ..measure.confidence import Thresholds
from ..measure.named import ONE_OF_SEVERAL
from .evidence import Balanced
from .verdict import EXPLAINED, NOT_IDENTIFIABLE, NOTHING, PARTLY, Reason, Verdict
from .words import certainty, is_guess, open_reason, some, subject, verb

SHIFT = "torque.delay"  # number of a torque column that is out of step


def balanced(found: Balanced, limit: Thresholds) -> Verdict:
    """What the torque of a joint says."""
    before, refitted, after = (found.errors[key].rmse for key in ("nominal", "refitted", "extended"))
    change = Reason(
        "error",
        f"The torque that the motion needs differs from the logged one by {before:.2f} N.m with the sidecar's numbers, "
        f"{refitted:.2f} N.m with these refitted, {after:.2f} N.m with what is handed over (held-out blocks).",
    )
    told = (change, *(open_reason(cause) for cause in found.open_causes))
    error = f"error {before:.2f} to {after:.2f} N.m"
    if found.turned:
        sentence = f"Refitted numbers alone explain more of the torque of '{found.joint}' than any cause: {error}."
        why = Reason("refitted", f"The model that is handed over is the nominal one with {found.turned}.")
        return Verdict(NOT_IDENTIFIABLE, sentence, (why, *told))
    if not found.causes:
        floor = found.errors["noise_floor"].rmse
        as_noise = after**2 - floor**2 <= limit.as_noise * floor**2
        if found.open_causes or not (as_noise or found.left < limit.torque_explained):
            sentence = f"No known cause explains the torque of '{found.joint}': {error} when tuned."
            most = math.sqrt(1.0 + limit.as_noise) * floor
            why = f"Up to {most:.2g} N.m would need none: noise of torque and motion, and the column's calibration."
            return Verdict(NOT_IDENTIFIABLE, sentence, told if as_noise else (*told, Reason("noise", why)))
        sentence = f"Nothing to explain: the torque of '{found.joint}' is as its tuned numbers say, {error}."
        if before <= limit.torque_as_good * after:
            sentence = f"Nothing to explain: neither its own numbers nor a shift lower the torque {error}."
        return Verdict(NOTHING, sentence, told)
    reasons = (*(Reason("cause", cause.sentence) for cause in found.causes), *told)
    doubtful = [cause for cause in found.causes if cause.standing == ONE_OF_SEVERAL]
    firm = [cause for cause in found.causes if cause.standing != ONE_OF_SEVERAL]
    if doubtful and not firm:
        sentence = (
            f"{subject(doubtful)} {verb(doubtful, 'fits', 'fit')} the torque of '{found.joint}' about as well as "
            f"{some(doubtful[0].rivals)}; {error}."
        )
        return Verdict(NOT_IDENTIFIABLE, sentence, reasons)
    if is_guess(firm, limit):
        sentence = (
            f"The torque of '{found.joint}' may lack {subject(firm)}, but that is a guess ({certainty(firm)}): {error}."
        )
        return Verdict(NOT_IDENTIFIABLE, sentence, reasons)
    known = not doubtful and all(cause.confidence >= limit.sure for cause in firm)
    name = EXPLAINED if found.left < limit.torque_explained and known else PARTLY
    what = f"{subject(firm)} {'' if name == EXPLAINED else 'partly '}{verb(firm, 'explains', 'explain')} the torque gap"
    step = "" if found.shift is None else f" ({_out_of_step(found)} out of step)"
    return Verdict(name, f"{what}{step}: {error}, {certainty(firm)}.", reasons)


def _out_of_step(found: Balanced) -> str:
    """By how much the torque column is; its interval goes beyond all that is tried where that is the least."""
    delay = next((c.parameters[SHIFT] for c in found.causes if SHIFT in c.parameters), None)
    if delay is not None and delay.high > MAX_SHIFT:
        return f"at least {1e3 * delay.low:.0f} ms"
    return f"{1e3 * abs(found.shift or 0.0):.0f} ms"
