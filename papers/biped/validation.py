"""Rows on what the paper validates: amplifier biases, both coordinates of a leg at once, the hop as a return map.

And on what it says of springs, phases and the torso while the biped hops.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ...actuators import Chain
from ...actuators.gravity import GRAVITY
from ...envs.biped.drive import ANGLE, DRIVES, PULLEYS, SHAPE, torque_chain
from ...envs.biped.parameters import SIDES
from ...envs.biped.robot import BIPED, coordinate
from ..published import Mark, Otherwise, Row
from . import choices
from .controller import PERIOD, Gait, Phase
from .ground import land
from .hopping import NAMES, Hopping, HoppingExperiment
from .identification import bias_by_arx
from .legs_together import Together, both_segments, fit_both
from .paper import (
    AS_PRINTED,
    CHOSEN,
    NO_BIAS,
    NO_UPDATE,
    SHOWN,
    STIFFER,
    SUBSTEPS,
    TORSO,
    Change,
    Identified,
    said,
    springs_as_printed,
)
from .return_map import HOPS, OFF, Healing, healing, settled
from .rig import blocked, drift_record, legs_record, noise_of
from .tables import input_rows

PLANTED: Mark = "planted and recovered"
IMPACT = 0.03  # [s] after a touchdown in which cables feel it
ARX: dict[str, Any] = {"judged": "assumed: 1 %, the encoder's noise", "rests": choices.PULLEYS_ALONE}
OPEN = ("boom_length", "foot_radius", "gains K_d", "gains K_p", "torque limits", "lean eta_Tor0", "travel delta_phi_d")
LEANS = (math.radians(4.0),)  # of the torso, beside the one chosen: how far what hops hand on hangs on it


def legs_together(side: str, identified: Mapping[str, Identified], stiffer: float = 1.0) -> Together:
    """V-C on the virtual machine: both coordinates of a leg at once, with what the stages before found of each.

    Args:
        side: of the leg.
        identified: by drive; friction is that of (19).
        stiffer: how many times as stiff as printed the cables are.
    """
    names = [coordinate(side, kind) for kind in (ANGLE, SHAPE)]
    drives, found = [DRIVES[name] for name in names], [identified[name] for name in names]
    return fit_both(
        legs_record(side, noise_of(f"{side} legs"), stiffer),
        both_segments(BIPED.parameters()),
        [drive.ratio for drive in drives],
        [item.motor.constant for item in found],
        [
            item.motor.factor * drive.rotor_inertia + PULLEYS[drive.kind][2]
            for item, drive in zip(found, drives, strict=True)
        ],
        [item.leg.friction for item in found],
        [item.pulleys[0].bias for item in found],
    )


@dataclass(frozen=True)
class Impact:
    """What the cable of a leg shape carries at most right after a touchdown, at the motor [N.m].

    Attributes:
        springs: with the springs.
        blocked: with springs that are blocked, from the same state.
    """

    springs: float
    blocked: float


def impact(springs: Callable[[str], Chain] = torque_chain) -> Impact:
    """Touch down in the same state with springs and with blocked ones."""
    before = HoppingExperiment(chains=springs, substeps=SUBSTEPS)
    before.run(3)
    names = [coordinate(side, SHAPE) for side in SIDES]
    columns = [NAMES.index(name) for name in names]
    stiffness, damping = (
        np.array([getattr(DRIVES[name], f"cable_{what}") for name in names]) for what in ("stiffness", "damping")
    )

    def most(chains: Callable[[str], Chain]) -> float:
        experiment = HoppingExperiment(chains=chains, substeps=SUBSTEPS)
        experiment.start_from(before)
        stretch = experiment.run(10_000, IMPACT).stretch[:, columns]
        return float(np.abs(stiffness * stretch + damping * np.gradient(stretch, PERIOD, axis=0)).max())

    return Impact(most(springs), most(blocked))


def soles_off(hopping: Hopping, clearance: float = 0.0) -> float:
    """Share of the time after the first touchdown in which both soles are off the floor by more than that [m]."""
    from ...envs.biped.env import soles  # its task is of learning

    later = hopping.hop >= 1
    heights = soles(BIPED.parameters(), hopping.hip[:, 1], hopping.pitch, hopping.link)[later]
    return float((heights > clearance).all(axis=1).mean()) if later.any() else 0.0


@dataclass(frozen=True)
class Validated:
    """What the rows here are made of.

    Attributes:
        biases: by drive, of the ARX model [N.m].
        together: both coordinates at once, by side.
        stiff: biases likewise on cables that are :data:`~sealegs.papers.biped.paper.STIFFER` times as stiff.
        heals: what becomes of a hop that is off, with the update and without, by what is assumed otherwise.
        impact: of a touchdown.
        as_printed: likewise, and the energy of hopping, with K_dB as table VI reads.
    """

    biases: Mapping[str, float]
    together: Mapping[str, Together]
    stiff: Mapping[str, tuple[float, float]]
    heals: Mapping[str, tuple[Healing, Healing]]
    impact: Impact
    as_printed: tuple[Impact, Energy]

    def document(self) -> dict[str, Any]:
        """As JSON has it."""
        return {
            "bias_by_arx": self.biases,
            "legs_together": {side: asdict(found) for side, found in self.together.items()},
            "healing": {
                label: {"with update": found[0].pitch.tolist(), "without": found[1].pitch.tolist()}
                for label, found in self.heals.items()
                if not any(item.fell for item in found)
            },
        }


def validate(identified: Mapping[str, Identified], say: Callable[[str], None]) -> Validated:
    """Run the experiments, with what was identified of each drive."""
    say("amplifier biases, and both coordinates of each leg at once")
    biases = {name: bias_by_arx(drift_record(name, noise_of(f"{name} drift"))) for name in DRIVES}
    together = {side: legs_together(side, identified) for side in SIDES}
    stiff = {side: legs_together(side, identified, STIFFER).bias for side in SIDES}
    say("what becomes of a hop that is off")
    leans = {f"lean {math.degrees(lean):.0f} deg": both_ways(Gait(torso=lean)) for lean in LEANS}
    return Validated(biases, together, stiff, {CHOSEN: both_ways(None), **leans}, impact(), as_printed())


def as_printed() -> tuple[Impact, Energy]:
    """Impact and energy of the springs with K_dB as table VI reads."""
    experiment = HoppingExperiment(chains=springs_as_printed, substeps=SUBSTEPS)
    return impact(springs_as_printed), energy(experiment.run(SHOWN[0]))


def rows(found: Validated, stretched: Hopping, changes: Sequence[Change]) -> list[Row]:
    """All rows of this module.

    Args:
        found: by :func:`validate`.
        stretched: recording of the hops.
        changes: what other values of assumed numbers do.
    """
    others = {label: pair for label, pair in found.heals.items() if label != CHOSEN}
    falls = "; ".join(said(item.figures) for item in changes if item.name == NO_UPDATE)
    return [
        *input_rows(),
        *_biases(found.biases),
        *leg_rows(found.together, found.stiff),
        *heal_rows(found.heals[CHOSEN], others, falls),
        _ground(),
        *_way(stretched, changes),
        _flight(stretched),
        *spring_rows(stretched, found.impact, found.as_printed),
        *carried_rows(changes),
    ]


def both_ways(gait: Gait | None) -> tuple[Healing, Healing]:
    """What becomes of a hop that is off, with and without the update of the lean (44)."""
    apex = settled(gait)
    return healing(apex, True), healing(apex, False)


def _biases(found: Mapping[str, float]) -> list[Row]:
    return [
        Row(
            f"{name.replace('_', ' ')}: b by ARX (31) to (33)", "table IV, Fig. 24", 1e3 * DRIVES[name].bias,
            1e3 * value, PLANTED, "1e-3 N.m", 0.01, **ARX,
        )
        for name, value in found.items()
    ]  # fmt: skip


def leg_rows(together: Mapping[str, Together], stiff: Mapping[str, tuple[float, float]]) -> list[Row]:
    """Biases, motion and what small errors of the bias do, of both coordinates at once, by side.

    Args:
        together: what was found.
        stiff: the biases, had the cables not stretched.
    """
    rows = []
    rests = (*choices.RIG, "right_cable")
    for side, found in together.items():
        for k, kind in enumerate((ANGLE, SHAPE)):
            printed = DRIVES[coordinate(side, kind)].leg_bias
            share = found.residual[k] / found.spread[k]
            rows += [
                Row(
                    f"{side} {kind.replace('_', ' ')}: b, both at once (20)", "table V", 1e3 * printed,
                    1e3 * found.bias[k], PLANTED, "1e-3 N.m", 0.1, judged="assumed", rests=rests,
                    sensitivity=(Otherwise("cables 100 times as stiff", 1e3 * stiff[side][k]),),
                ),
                Row(
                    f"{side} {kind.replace('_', ' ')}: simulated beside measured, both at once", "Fig. 16",
                    "match very closely", f"{math.degrees(found.residual[k]):.2f} deg rms, {share:.1%} of the motion",
                    PLANTED, agrees=share < 0.1, judged="assumed: a tenth of the motion", rests=rests,
                ),
            ]  # fmt: skip
        off = [math.degrees(value) for value in found.unadjusted]
        rows.append(
            Row(
                f"{side} leg, both at once: small errors of the bias, large deviations above all of the shape", "V-C",
                "stated", f"with the biases of table IV: {off[0]:.1f} deg of the angle, {off[1]:.1f} deg of the shape",
                "predicted", agrees=off[1] > off[0] and off[1] > 10.0 * math.degrees(found.residual[1]),
                judged="larger in the shape; assumed: ten times what (20) leaves", rests=rests,
            )
        )  # fmt: skip
    return rows


def heal_rows(
    heals: tuple[Healing, Healing], others: Mapping[str, tuple[Healing, Healing]], falls: str = ""
) -> list[Row]:
    """What becomes of a hop that is off, with the update of the lean and without.

    Args:
        heals: with and without.
        others: likewise, by what is assumed otherwise.
        falls: what becomes of hopping without the update, started with the chosen lean.
    """

    def said(found: Healing) -> str:
        return "falls" if found.fell else f"{1e3 * found.left:.2f} mrad, {found.multiplier:.2f} times a hop"

    found = [tuple(Otherwise(label, said(pair[k])) for label, pair in others.items()) for k in range(2)]
    rests = (*choices.HOPPING, "return_map")
    start = (Otherwise("started with the chosen lean", falls),) if falls else ()
    return [
        Row(
            choices.HEALS, "VIII-D", "stable", said(heals[0]), "fitted", agrees=heals[0].multiplier < 1.0,
            judged=f"smaller after {HOPS} hops or not", rests=rests, sensitivity=found[0],
            note="gains and lean were searched for hopping that lasts; with another lean it does not heal",
        ),
        Row(
            f"{1e3 * OFF:g} mrad of pitch grows without the update", "VIII-D", "unstable", said(heals[1]), "predicted",
            agrees=heals[1].multiplier >= 1.0, judged=f"larger after {HOPS} hops or not", rests=rests,
            sensitivity=(*found[1], *start),
            note="about the hop that the update has settled on, whose lean is kept",
        ),
    ]  # fmt: skip


def _ground() -> Row:
    landing = land()
    share = landing.misfit / float(landing.force.max())
    return Row(
        choices.LANDING,
        "table VI",
        "printed law",
        f"off by {share:.1%} of its largest force, rms",
        "fitted",
        agrees=share < 0.05,
        judged="assumed: under 5 %",
        rests=choices.ROBOT,
    )


def _way(stretched: Hopping, changes: Sequence[Change]) -> list[Row]:
    """How far a hop goes, how far the knees straighten and the cables stretch: what the search did not look at."""
    boom = 100.0 * BIPED.parameters()["boom_length"]
    asked = -boom * Gait().travel
    later = stretched.hop >= 1
    forward = stretched.hip[later, 0]
    found = 100.0 * float(forward[0] - forward[-1]) / max(stretched.hops - 1, 1)
    least = [math.degrees(float(stretched.link[later, column].min())) for column in (1, 3)]
    stretch = math.degrees(float(np.abs(stretched.stretch[later]).max()))

    def told(way: float) -> str:
        return f"{math.degrees(-way / boom):.2f} deg, {way:.1f} cm"

    return [
        Row(
            "turn of the boom in a hop, and the hip's way backwards", "(46)", "-69 deg", told(found), "predicted",
            agrees=abs(found / asked - 1.0) <= 0.1, judged="assumed: a tenth of delta_phi_d as read",
            rests=choices.HOPPING,
            note=f"the paper prints no way; its -69 is read as {math.degrees(Gait().travel):.2f} deg, {asked:.1f} cm "
            "on the assumed boom. The update (44) acts on the lean and does not reach it with these gains",
            sensitivity=tuple(
                Otherwise(
                    f"{change.name} {change.value}",
                    said(change.figures) if change.figures.fell else told(-100.0 * change.figures.travel),
                )
                for change in changes
                if change.name in OPEN
            ),
        ),
        Row(
            "least leg shape, left and right; 0 is a straight knee", "I", "not below 0",
            f"{least[0]:.1f} and {least[1]:.1f} deg", "predicted", agrees=min(least) >= 0.0, judged="a bound",
            note="the model has no stop in the knee", rests=choices.HOPPING,
        ),
        Row(
            "significant stretch of the cables", "VIII-D", "stated", f"up to {stretch:.0f} deg at the motor",
            "predicted", agrees=stretch > 10.0, judged="assumed: over 10 deg", rests=choices.HOPPING,
            note="rigid cables are no other model here: they stretch by nothing, whatever they carry",
        ),
    ]  # fmt: skip


def _flight(stretched: Hopping) -> Row:
    return Row(
        choices.SOLES, "VIII-D", "hops", f"{soles_off(stretched):.1%}", "fitted", agrees=soles_off(stretched) > 0.0,
        judged="more than none", rests=choices.HOPPING,
        note="the controller's phases of flight and retraction last longer: flight ends when both feet have touched",
    )  # fmt: skip


@dataclass(frozen=True)
class Energy:
    """Of a hop, mean over the hops [J].

    Attributes:
        stored: in the springs, at most.
        risen: that the hip's way up is worth.
    """

    stored: float
    risen: float

    def __str__(self) -> str:
        return f"{self.stored:.0f} J of {self.risen:.0f} J that the hip's way up is worth"


def energy(stretched: Hopping) -> Energy:
    """What the springs store in hopping."""
    stiffness = np.array([DRIVES[coordinate(side, SHAPE)].spring_stiffness for side in SIDES])
    energy = 0.5 * (stretched.spring**2 @ stiffness)
    hops = [stretched.hop == hop for hop in range(1, max(stretched.hops, 2))]
    stored = float(np.mean([energy[hop].max() for hop in hops]))
    mass = float(HoppingExperiment().model.body_subtreemass[0])
    return Energy(stored, mass * GRAVITY * float(np.mean([np.ptp(stretched.hip[hop, 1]) for hop in hops])))


def spring_rows(stretched: Hopping, impact: Impact, as_printed: tuple[Impact, Energy]) -> list[Row]:
    """What springs do while the biped hops, and which foot leaves the floor first."""
    found = energy(stretched)
    phase = stretched.phase.astype(int)
    after = phase[1:][(phase[:-1] == Phase.KICK_OFF) & (phase[1:] != Phase.KICK_OFF)]
    counts = [int((after == follows).sum()) for follows in (Phase.LEFT_OFF, Phase.RIGHT_OFF, Phase.RETRACT)]
    return [
        Row(
            "springs store energy in the compression", "I, IX", "stated",
            str(found), "predicted", agrees=found.stored > 0.1 * found.risen, judged="assumed: over a tenth",
            rests=choices.HOPPING, sensitivity=(Otherwise(AS_PRINTED, str(as_printed[1])),),
        ),
        Row(
            "springs isolate the rotors of the leg shapes from the impact", "I, IX", "stated",
            f"{impact.springs:.1f} N.m in the cables within {1e3 * IMPACT:.0f} ms of a touchdown", "predicted",
            agrees=impact.springs < impact.blocked, judged="less than with blocked springs, or not",
            rests=choices.HOPPING,
            sensitivity=(
                Otherwise("springs blocked", f"{impact.blocked:.1f} N.m"),
                Otherwise(AS_PRINTED, f"{as_printed[0].springs:.1f} N.m, blocked {as_printed[0].blocked:.1f}"),
            ),
        ),
        Row(
            "from phase III each of three phases can follow", "VIII-B, Fig. 20", "stated",
            "first off the floor: left {}, right {}, both {} times".format(*counts), "predicted",
            agrees=min(counts) > 0, judged="all three occur, or not", rests=choices.HOPPING,
        ),
    ]  # fmt: skip


def carried_rows(changes: Sequence[Change]) -> list[Row]:
    """What biases and the torso's mass do to hopping; no rows where that was not tried."""
    tried = {name: [item for item in changes if item.name == name] for name in (CHOSEN, NO_BIAS, *TORSO)}
    if not all(tried.values()):
        return []
    chosen = tried[CHOSEN][0].figures

    def moved(change: Change) -> float:
        """Relative change of the period; inf where it ends."""
        found = change.figures
        return math.inf if found.fell or math.isnan(found.period) else abs(found.period / chosen.period - 1.0)

    def told(change: Change) -> str:
        found = change.figures
        return (
            said(found) if math.isinf(moved(change)) else f"a period of {found.period:.3f} s for {chosen.period:.3f} s"
        )

    (bias,) = tried[NO_BIAS]
    rests = (*choices.HOPPING, "settled")
    return [
        Row(
            "small torque biases are negligible while the legs carry the torso", "V-A, note 4", "stated",
            f"without them {told(bias)}", "predicted", agrees=moved(bias) < 0.1, judged="assumed: under a tenth",
            rests=rests,
        ),
        *(
            Row(
                f"the torso's {name.partition('_')[2]} strongly affects the dynamics", "VI", "stated",
                "; ".join(f"{item.value}: {told(item)}" for item in tried[name]), "predicted",
                agrees=min(map(moved, tried[name])) > 0.1, judged="assumed: by more than it changes, a tenth",
                rests=rests,
            )
            for name in TORSO
        ),
    ]  # fmt: skip
