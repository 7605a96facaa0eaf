"""A chain taught by the virtual body that lengthens: its axial numbers again, and both chambers together predicted."""

from __future__ import annotations

import lengthening
import pytest

from pliant.testbed.rod import actuator


@pytest.mark.slow
def test_a_chain_finds_the_rod_s_axial_numbers_and_predicts_both_chambers():
    experiments, model = lengthening.recorded(2, [*lengthening.TRAIN, "both_100"])
    fitted = lengthening.taught([experiments[name] for name in lengthening.TRAIN], model)
    found = {p.name: p for p in fitted.parameters}
    for name, true in lengthening.truth(actuator("lengthening")).items():
        assert abs(found[name].value - true) < 2.5 * found[name].std
        assert found[name].value == pytest.approx(true, rel=0.2)  # errors of the model's form are stated larger
    error, made, seen = lengthening.missed(experiments["both_100"], fitted)
    assert error < 1.5
    assert made == pytest.approx(seen, abs=0.5)
    assert seen > 25.0
