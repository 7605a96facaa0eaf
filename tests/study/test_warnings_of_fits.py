"""The headline speaks of the first fit; warnings about other fits are in the verdict."""

from __future__ import annotations

from dataclasses import replace

from pliant.selection import ModelSelection
from pliant.study.schema import Targets
from pliant.study.verdict import headline, verdict


def test_a_warning_about_another_fit_is_no_warning_about_the_first(outcome):
    first, second = (replace(f, records=f.records[:1], title=t) for f, t in zip(outcome.fits, "ab", strict=True))
    doubts = ("a: its mass is 3 t.", "b: torque_2 is not determined.", "low and high hold the same numbers.")
    study = replace(outcome, fits=(first, second), doubts=doubts)
    warnings = headline(study, Targets()).warnings
    assert [d for d in doubts if d in warnings] == [doubts[0], doubts[2]]
    assert doubts[1] in verdict(study, Targets())
    assert doubts[0] not in verdict(study, Targets())


def test_a_warning_about_fits_of_the_same_name_stays_in_the_headline(outcome):
    fits = tuple(replace(f, records=f.records[:1], title="a") for f in outcome.fits)
    study = replace(outcome, fits=fits, doubts=("a: its mass is 3 t.",))
    assert "a: its mass is 3 t." in headline(study, Targets()).warnings


def test_weakly_determined_parameters_of_a_chosen_model_are_in_the_full_verdict_alone(outcome):
    note = "creep_time_1 is weakly determined (standard error 54 %): fix creep_time_1."
    first = replace(outcome.fits[0], records=outcome.fits[0].records[:1])
    first = replace(first, result=replace(first.result, notes=(note,)))
    stated = replace(outcome, fits=(first,))
    selection = ModelSelection((), (), "a lower error", None, 1.0)
    assert note in headline(replace(stated, model_selection=selection), Targets()).warnings, "the choice has no fit"
    chosen = replace(outcome, fits=(replace(first, name="model_selection"),), model_selection=selection)
    assert note in headline(stated, Targets()).warnings
    assert note not in headline(chosen, Targets()).warnings
    assert any(note in line for line in verdict(chosen, Targets()))
