"""One frame in one compiled call: a Kalman filter or the observer, then the regulator. What a frame costs."""

from __future__ import annotations

from pliant.control.feedback_loops import steer
from pliant.estimation.adaptive_observer_loops import follow_fields, rest_shift
from pliant.estimation.kalman_loops import predict_span, update


def filter_and_steer(state, shift, model, prediction, sight, regulator, lead, scratch, out):
    """The filter's prediction to the time of a frame, its correction, and the regulator's command [Pa]; -1: it failed.

    `state` is (angle, rate, disturbance (n,), covariance, states of the memory), `shift` (n,) takes the rest shifts of
    the model without memory. `model` is (chain of `predict`, model of `follow`), `prediction` (steps, their length
    [s], torque [N m], noise), `sight` the arguments of `update` from `l` to `innovation`, `regulator` (table, place,
    rules, aim, valve, waiting, held) of `steer`.
    """
    angle, rate, own, P, memory_state = state
    chain, body = model
    steps, h, torque, noise = prediction
    if predict_span(angle, rate, own, P, memory_state, chain, steps, h, torque, noise, scratch) < 0:
        return -1.0
    l, first, rows, z, R, innovation = sight
    update(angle, rate, own, P, memory_state, chain, l, first, rows, z, R, innovation, scratch)
    for i in range(len(shift)):
        scratch.w[i] = own[i] / chain[2].K[i]
    rest_shift(
        angle, scratch.w, memory_state, body.base_angle, body.rest_angle, body.memory, body.instantaneous, shift
    )
    table, place, rules, aim, valve, waiting, held = regulator
    return steer(table, place, rules, aim, angle, rate, shift, valve, lead, waiting, held, out)


def many_filtered(count, state, shift, model, prediction, sight, regulator, lead, scratch, out):
    """`count` frames of `filter_and_steer`, the same each time."""
    command = 0.0
    for _ in range(count):
        command = filter_and_steer(state, shift, model, prediction, sight, regulator, lead, scratch, out)
    return command


def many_followed(count, observer, regulator, lead, out):
    """`count` frames of `follow` and `steer`, the same each time.

    `observer` holds the arguments of `follow_fields`: (periods, pressure, values, state and the rest).
    """
    periods, pressure, values, state, model, gains, pace, workspace = observer
    angle, rate, _own, _innovation, shift, _memory, _by, factor, _slow = state
    table, place, rules, aim, valve, waiting, held = regulator
    target, _scale, lead_tip = aim
    command = 0.0
    for _ in range(count):
        follow_fields(periods, pressure, values, state, model, gains, pace, workspace)
        now = (target, factor[0], lead_tip)
        command = steer(table, place, rules, now, angle, rate, shift, valve, lead, waiting, held, out)
    return command
