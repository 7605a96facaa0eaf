"""One frame in one compiled call: a Kalman filter or the observer, then the regulator. What a frame costs."""

from __future__ import annotations

from pliant.control.feedback_loops import steer
from pliant.estimation.adaptive_observer_loops import follow, rest_shift
from pliant.estimation.kalman_loops import predict_span, update


def filter_and_steer(state, shift, model, prediction, frame, regulator, workspace):
    """The filter's prediction to the time of a frame, its correction, and the regulator's command [Pa]; -1: it failed.

    `state`, `prediction`, `frame` and `workspace` are those of `kalman_loops`, `shift` (n,) takes the rest shifts of
    the model without memory, `model` is (FilterModel, ObserverModel), `regulator` a `symbols.Regulator`.
    """
    chain, body = model
    if predict_span(state, chain, prediction, workspace) < 0:
        return -1.0
    update(state, chain, frame, workspace)
    for i in range(len(shift)):
        workspace.w[i] = state.disturbance[i] / chain.joints.K[i]
    rest_shift(
        state.angle, workspace.w, state.memory, body.joints.base_angle, body.joints.theta0, body.memory,
        body.instantaneous, shift,
    )
    law, aim, valve, lead, memory = regulator
    return steer(law, aim, (state.angle, state.rate, shift, valve), lead, memory)


def many_filtered(count, state, shift, model, prediction, frame, regulator, workspace):
    """`count` frames of `filter_and_steer`, the same each time."""
    command = 0.0
    for _ in range(count):
        command = filter_and_steer(state, shift, model, prediction, frame, regulator, workspace)
    return command


def many_followed(count, observer, regulator):
    """`count` frames of `follow` and `steer`, the same each time.

    `observer` holds the arguments of `follow`: (periods, pressure, values, state and the rest).
    """
    periods, pressure, values, state, model, gains, pace, workspace = observer
    law, aim, valve, lead, memory = regulator
    target, _scale, lead_tip = aim
    command = 0.0
    for _ in range(count):
        follow(periods, pressure, values, state, model, gains, pace, workspace)
        seen = (state.angle, state.rate, state.rest_shift, valve)
        command = steer(law, (target, state.factor[0], lead_tip), seen, lead, memory)
    return command
