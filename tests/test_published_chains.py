"""Fits of BAM, models M1 to M6, as chains: the law gives the published friction budget."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sealegs.actuators import load_chain
from sealegs.actuators.stages import ChainError

from tests.test_laws import limit

DATA = Path(__file__).resolve().parents[1] / "../shared/data"
PLAIN: dict[str, Any] = {
    "kt": 1.2,
    "R": 2.7,
    "armature": 0.02,
    "friction_base": 0.05,
    "friction_viscous": 0.03,
    "actuator": "mx106",
}
AT_REST = {"friction_stribeck": 0.04, "dtheta_stribeck": 0.3, "alpha": 1.4}
LOAD = {"load_friction_base": 0.1}
BOTH = {**AT_REST, **LOAD, "load_friction_stribeck": 0.15}
DIRECTIONAL = {
    **AT_REST, "load_friction_motor": 0.04, "load_friction_external": 0.24, "load_friction_motor_stribeck": 0.1,
    "load_friction_external_stribeck": 0.03,
}  # fmt: skip
QUADRATIC = {**DIRECTIONAL, "load_friction_motor_quad": 0.008, "load_friction_external_quad": 0.003}
MODELS = {"m1": {}, "m2": AT_REST, "m3": LOAD, "m4": BOTH, "m5": DIRECTIONAL, "m6": QUADRATIC}


def budget(model: str, fit: dict[str, Any], w: float, tm: float, te: float) -> float:
    """Friction budget [N.m] as published (Duclusaud et al., ICRA 2025), of speed, motor and external torque."""
    b = fit["friction_viscous"] * abs(w) + fit["friction_base"]
    if model == "m1":
        return b
    if model == "m3":
        return b + fit["load_friction_base"] * abs(tm - te)
    s = math.exp(-(abs(w / fit["dtheta_stribeck"]) ** fit["alpha"]))
    if model == "m2":
        return b + s * fit["friction_stribeck"]
    if model == "m4":
        load = abs(tm - te)
        return (
            b + fit["load_friction_base"] * load + s * (fit["friction_stribeck"] + fit["load_friction_stribeck"] * load)
        )
    b += abs(fit["load_friction_motor"] * tm - fit["load_friction_external"] * te)
    b += s * fit["friction_stribeck"]
    b += s * abs(fit["load_friction_motor_stribeck"] * tm - fit["load_friction_external_stribeck"] * te)
    if model == "m6" and np.sign(tm) != np.sign(te):
        if abs(te) < abs(tm):
            b += s * fit["load_friction_external_quad"] * te**2
        else:
            b += s * fit["load_friction_motor_quad"] * tm**2
    return b


def written(folder: Path, model: str, changed: dict[str, object] | None = None) -> str:
    path = folder / f"{model}.json"
    path.write_text(json.dumps({**PLAIN, **MODELS[model], "model": model, **(changed or {})}))
    return f"bam:{path}"


def assert_same_budget(source: str, model: str, fit: dict[str, Any]) -> None:
    rng = np.random.default_rng(3)
    friction = next(stage["friction"] for stage in load_chain(source).to_list() if "friction" in stage)
    for w, tm, te in rng.uniform(-1.5, 1.5, (60, 3)):
        ours = limit(friction, motor=tm, external=te, w=w) + friction["viscous"] * abs(w)
        assert ours == pytest.approx(budget(model, fit, w, tm, te), abs=1e-9), (w, tm, te)


@pytest.mark.parametrize("model", MODELS)
def test_the_law_gives_the_published_friction_budget(tmp_path: Path, model: str) -> None:
    assert_same_budget(written(tmp_path, model), model, {**PLAIN, **MODELS[model]})


@pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured data in {DATA}")
def test_a_published_file_is_read_whole() -> None:
    path = DATA / "bam_sts3215_m6.json"
    fit = json.loads(path.read_text())
    assert_same_budget(f"bam:{path}", "m6", fit)
    chain, shipped = load_chain(f"bam:{path}"), load_chain("sts3215_m6")
    assert chain.value("position_p.gain") == pytest.approx(32 * 0.166 * fit["error_gain_ratio"])
    assert [stage.name for stage in chain.stages] == [stage.name for stage in shipped.stages]
    for name in (
        "dc_motor.motor_constant",
        "friction.load",
        "friction.load_external",
        "friction.load_stribeck_external",
    ):
        assert shipped.value(name) == pytest.approx(chain.value(name), rel=1e-3)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"model": "m7"}, "its 'model' must be one of m1"),
        ({"actuator": "mx16"}, "whose drive is not known .did you mean"),
        ({"kt": None}, "'kt' must be a number"),
    ],
)
def test_a_fit_that_is_none_gets_one_sentence(tmp_path: Path, changed: dict[str, object], sentence: str) -> None:
    with pytest.raises(ChainError, match=sentence):
        load_chain(written(tmp_path, "m4", changed))
    with pytest.raises(ChainError, match="cannot read the fit"):
        load_chain(f"bam:{tmp_path / 'absent.json'}")
