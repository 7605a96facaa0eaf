"""State estimation from a whole recording: Kalman filter, fixed-lag smoother, and tests of consistency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from pliant.compiler.choose import twin
from pliant.errors import InputError, SimulationError
from pliant.estimation import kalman_loops
from pliant.estimation.adaptive_observer import without_valves
from pliant.estimation.measurement import Measurement, flips, measurement_of, observed_stations, row_width
from pliant.estimation.noise import Noise, default_noise
from pliant.estimation.symbols import (
    FilterFrame,
    FilterModel,
    FilterNoise,
    FilterOutput,
    FilterState,
    Prediction,
    make_output,
    make_workspace,
)
from pliant.identification.drives import measured
from pliant.mechanics import mechanics_of
from pliant.mechanics.lengths import check_lengths
from pliant.model import Model
from pliant.simulation import BaseMotion, Pulse, Trace, state
from pliant.simulation.base_motion import BaseSteps, base_fields
from pliant.simulation.drive import Drive
from pliant.simulation.drive import drive as drive_plan
from pliant.simulation.inputs import Input
from pliant.simulation.result import about_inputs, inputs_of
from pliant.version import __version__

Array = np.ndarray
STEPS = (5e-3, 2e-3, 1e-3, 5e-4)  # s, of predictions, tried in turn


def estimate(
    recording: xr.Dataset,
    model: Model,
    *,
    noise: Noise | None = None,
    pressure: Input | Sequence[Input] | None = None,
    drive: Mapping[str, str | int] | None = None,
    disturbance: bool = True,
    stations: tuple[str, ...] | None = None,
    latency: float = 0.0,
    time_step: float | None = None,
    lag: int = 10,
    pressure_window: float = 8e-3,
    base: BaseMotion | None = None,
) -> xr.Dataset:
    """Estimate joint angles, rates and disturbance torques from a recording, by extended Kalman filter and smoother.

    Parameters
    ----------
    recording : xarray.Dataset
        Aligned recording of the model's stations, with angles where recorded, or of a dense curve, base first. Angles
        without positions are those since rest: see `pliant.preprocessing.angles.from_rest`. For a model in space, its
        stations with orientations of rigid bodies where recorded; orientations that differ from the estimate by more
        than 90 degrees (flipped markers) are ignored and counted. Missing values are skipped and counted.
    model : Model
    noise : Noise, optional
        Default: in proportion to the model's stiffness, see `pliant.estimation.noise.default_noise`.
    pressure : Input, or one for each input of the model, optional
        Commanded pressure, or tension, displacement or angle, which passes through the model's valve. Default: the
        measured one, taken as behind the valve.
    drive : dict, optional
        For a model of several inputs: maps each input of the model to the recorded one that drives it, by name or index
        (from 0). Inputs not listed stay at 0. Default: the recorded inputs of the same names.
    disturbance : bool
        Whether to estimate an unknown torque of each joint too, which absorbs model error. If `noise` is given, its
        `random_walk` decides.
    stations : tuple of str, optional
        Stations to use. Default: all that recording and model share.
    latency : float
        Delay of the shape's time stamps on the clock of the pressure, s.
    time_step : float, optional
        Longest integration step of a prediction, s. Default: 5 ms, or 2, 1 or 0.5 ms if a prediction with longer steps
        fails, as for stiff bodies. The attribute `step_s` of the result states it.
    lag : int
        Number of later frames that the smoothed states use.
    pressure_window : float
        Width of the centred moving average of measured inputs, s. Sensor noise of the pressure disturbs light links
        more than the noise of a frame. A window of up to twice the latency of the shape adds no delay.
    base : BaseMotion, optional
        Prescribed motion of the base on the clock of the inputs. The recording, and the result, are then in the axes of
        the moved base. By default the base rests.

    Returns
    -------
    xarray.Dataset
        joint_angle [rad], joint_rate [rad/s] and disturbance [N m] (time, joint), filtered; `smooth_*`, smoothed with
        `lag` later frames; `*_sd`, their standard deviations. In space for each axis: joint_angle_x, joint_angle_y,
        joint_angle_twist ... For extensible segments: axial_strain, axial_strain_rate, axial_disturbance [N]
        (time, segment). Also innovation (time, row), whitened; normalised_innovation_squared and rows_used (time).
        attrs: nis_ratio with its 95 % bounds, innovation_correlation with its bound, frames skipped, orientations
        flipped, notes.

    Raises
    ------
    InputError
        When the recording does not show the model, or has no inputs and none are given, or inputs differ in kind, or
        the motion of the base does not fit the model or cover the recording, or is not given for a base that moves.
    SimulationError
        When a prediction fails.

    Examples
    --------
    On recordings of your own::

        import pliant
        from pliant.estimation import Noise, estimate
        model = pliant.load_model("results/arm/model.json")
        recording = pliant.align(pliant.read("arm.c3d"))
        found = estimate(recording, model, latency=0.004)
        found.joint_rate[-1].values                                # rad/s, now
        found.smooth_joint_rate.values                             # rad/s, ten frames later
        found.attrs["nis_ratio"], found.attrs["nis_bounds"]        # 1 where the covariances are right
        found.disturbance, found.disturbance_sd                    # N m of each joint: external forces, model error
    """
    settings = noise or default_noise(model, disturbance=disturbance, recordings=[recording])
    carried = base is not None
    observed_stations(recording, model, stations, carried=carried)  # refused before inputs are looked for
    source, body = input_of(recording, model, pressure, pressure_window, drive)
    begin = recording["time"].values[:1] - latency
    first = np.array([float(one(begin)[0]) for one in (source if isinstance(source, Sequence) else [source])])
    measurement = measurement_of(recording, model, settings, stations, first, carried=carried)
    times = measurement.time - latency
    if times.size < 3:  # the first meets the assumed start, and two more are compared with each other
        raise InputError(f"estimation needs at least three frames, got {times.size}: record for longer")
    steps = STEPS if time_step is None else (time_step,)
    for step in steps:
        plan = drive_plan(body, source, times, step)
        try:
            out = run(body, measurement, plan, settings) if base is None else run_on_base(
                BaseSteps(body, base), measurement, plan, settings, float(times[0]))  # fmt: skip
            break
        except SimulationError:
            if step == steps[-1]:
                raise
    return described(body, measurement, out, settings, plan, lag).assign_attrs(step_s=step)


def input_of(
    recording: xr.Dataset, model: Model, pressure: Input | Sequence[Input] | None, window: float = 0.0,
    drive: Mapping[str, str | int] | None = None,
) -> tuple[Input | Sequence[Input], Model]:
    """Return the inputs for the filter, and the model that takes them. For recorded inputs the model has ideal valves
    and motors, since these inputs are taken as measured behind the valves and at the motors.
    """
    if pressure is not None:
        return pressure, model
    if not {"pressure", "actuation"} & set(recording):
        raise InputError("the recording has no measured pressure or other input: give the commanded one "
                         "(pressure=Pulse(...))")  # fmt: skip
    if not (np.isfinite(window) and window >= 0):
        raise InputError(f"pressure_window must be a time in seconds, at least 0, got {window}")
    traces = measured("to estimate", recording, model, drive)
    sources = tuple(t if isinstance(t, Pulse) else Trace(*averaged(t.time, t.pressure, window)) for t in traces)
    return sources, without_valves(model)


def averaged(clock: Array, values: Array, window: float) -> tuple[Array, Array]:
    """Return times and values of the moving average over `window` [s] of a signal that is linear between samples.

    The window narrows towards both ends. Where samples are further apart than half the window, times are added at which
    the mean starts and stops changing.
    """
    if window == 0 or clock.size < 2:
        return clock, values
    integral = np.append(0.0, np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(clock)))
    instants = clock
    if np.diff(clock).max() > 0.5 * window:
        instants = np.unique(np.concatenate([clock, clock - 0.5 * window, clock + 0.5 * window]))
        instants = instants[(instants >= clock[0]) & (instants <= clock[-1])]
    half = np.minimum(0.5 * window, np.minimum(instants - clock[0], clock[-1] - instants))
    mean = np.interp(instants, clock, values)
    inner = half > 0
    gained = primitive(instants + half, clock, values, integral) - primitive(instants - half, clock, values, integral)
    mean[inner] = gained[inner] / (2.0 * half[inner])
    return instants, mean


def primitive(at: Array, clock: Array, values: Array, integral: Array) -> Array:
    """Return the integral of a signal, linear between samples, from the first sample to each of the times `at`."""
    k = np.clip(np.searchsorted(clock, at, side="right") - 1, 0, clock.size - 2)
    u = at - clock[k]
    slope = (values[k + 1] - values[k]) / (clock[k + 1] - clock[k])
    return np.asarray(integral[k] + u * (values[k] + 0.5 * slope * u))


def run(model: Model, measurement: Measurement, plan: Drive, noise: Noise) -> FilterOutput:
    """Run the compiled Kalman filter over all frames of a measured recording."""
    states, (frames, rows) = noise.states(model), measurement.value.shape
    q = state.equilibrium(model, plan.initial)
    check_lengths(mechanics_of(model), torque=plan.joint_torque)
    start = FilterState(
        mechanics_of(model).coordinates(q), np.zeros(model.size), np.zeros(model.size), noise.initial(model),
        state.relaxed(model, q),
    )
    ends = np.flatnonzero(plan.keep >= 0) + 1
    begin = np.concatenate([[0, 0], ends]).astype(np.int64)  # no step leads to the first frame
    out = make_output(frames, states, rows)
    failed = twin(kalman_loops.filter_record, *mechanics_of(model).sizes)(
        start, chain_of(model), (plan.h, plan.joint_torque, begin), FilterNoise(*noise.densities(model), np.zeros(1)),
        frame_of(model, *measurement[1:4]), out, make_workspace(model, states, rows),
    )
    if failed >= 0:
        raise prediction_fails(measurement, failed)
    return out


def prediction_fails(measurement: Measurement, frame: int) -> SimulationError:
    """Return the error for a frame, by its index, that the filter cannot predict."""
    return SimulationError(
        f"the prediction of frame {frame} at {measurement.time[frame]:.6g} s fails: a link turns by more than a "
        "radian in one step; use a shorter step, or check pressure and model"
    )


def run_on_base(base: BaseSteps, measurement: Measurement, plan: Drive, noise: Noise, begin: float) -> FilterOutput:
    """Run the Kalman filter over all frames of a recording whose base moves; `begin` is the time of the first one [s].

    Each step has a body of its own, on which the acceleration of the base acts as gravity does.
    """
    model, chain = base.model, base.chain
    states, (frames, rows) = noise.states(model), measurement.value.shape
    q, n = base.rest(plan.initial, begin), 2 * model.size
    now = FilterState(
        chain.coordinates(q), np.zeros(model.size), np.zeros(model.size), noise.initial(model), state.relaxed(model, q),
    )
    constants = chain_of(model)._replace(body=chain.body, joints=chain.joints)
    arrays = make_workspace(model, states, rows)._replace(held=chain.held())
    predict, record = (twin(k, *chain.sizes) for k in (kalman_loops.predict_span, kalman_loops.filter_record))
    moves, fields = base_fields(chain, base.motion, begin + np.append(0.0, np.cumsum(plan.h)))
    density, frame = FilterNoise(*noise.densities(model), np.zeros(1)), frame_of(model, *measurement[1:4])
    out, ends = make_output(frames, states, rows), [0, *(np.flatnonzero(plan.keep >= 0) + 1).tolist()]
    nothing = plan.h[:0], plan.joint_torque[:0], np.zeros(2, dtype=np.int64)
    for f, end in enumerate(ends):
        transition = np.eye(states)
        for k in range(ends[max(f - 1, 0)], end):
            prediction = Prediction(1, float(plan.h[k]), plan.joint_torque[k], density)
            step = partial(predict, now, with_gravity(constants, fields[k]), prediction, arrays)
            if base.advance(step, moves[k], now.angle, now.rate) < 0:
                raise prediction_fails(measurement, f)
            transition[:n] = arrays.J[:states, :n].T @ transition
        part = FilterOutput(*(a[f : f + 1] for a in out))
        record(now, constants, nothing, density, frame._replace(values=frame.values[f : f + 1]), part, arrays)
        out.transition[f] = transition
    return out


def frame_of(model: Model, rows: Array, value: Array, variance: Array) -> FilterFrame:
    """Return the measurement in the form that the compiled filter takes, for m values of one frame (m,) or of T frames
    (T, m).
    """
    chain = mechanics_of(model).observed
    return FilterFrame(model.base_angle, chain, row_width(model), rows, value, variance, np.empty(len(rows)))


def chain_of(model: Model) -> FilterModel:
    """Return the model constants that the compiled filter takes."""
    gain, memory = np.array(model.actuation.columns), model.memory
    return FilterModel(gain, *mechanics_of(model).parts()[:2], memory.law(), bool(memory))


def with_gravity(chain: FilterModel, field: Array) -> FilterModel:
    """Return the model constants with another gravity, a field (2,) or (3,) [m/s^2]."""
    return chain._replace(body=chain.body._replace(**dict(zip(("gx", "gy", "gz"), field.tolist(), strict=False))))


def split(model: Model, x: Array, P: Array) -> dict[str, tuple[Any, ...]]:
    """Return joint coordinates, rates and disturbance torques with their standard deviations, from states x and
    covariances P.

    `x` is (T, k N), `P` (T, k N, k N). The result holds dataset variables: name to dimensions, values and units.
    """
    chain, size = mechanics_of(model), model.size
    variables: dict[str, tuple[Any, ...]] = {}
    for k in range(x.shape[1] // size):
        rows = slice(k * size, (k + 1) * size)
        part = x[:, rows]
        values = (chain.joint_coordinates(part), chain.joint_rates(part), part / chain.lever)[k]
        sd = standard_deviations(np.diag(1.0 / chain.lever) if k == 2 else chain.to_joints, P[:, rows, rows])
        for kind in chain.kinds:
            variables[kind.names[k]] = (("time", kind.over), values[:, kind.rows], kind.units[k])
            variables[f"{kind.names[k]}_sd"] = (("time", kind.over), sd[:, kind.rows], kind.units[k])
    return variables


def standard_deviations(T: Array, P: Array) -> Array:
    """Return the standard deviations (frames, n) of n linear combinations T x of the N states x. T (n, N) holds the
    coefficients, P (frames, N, N) the covariances of x.
    """
    return np.sqrt(np.maximum(np.einsum("ia,tab,ib->ti", T, P, T), 0.0))


def described(
    model: Model, measurement: Measurement, out: FilterOutput, noise: Noise, plan: Drive, lag: int
) -> xr.Dataset:
    """Return the dataset of `estimate` with filtered and smoothed states, from the output of the filter."""
    data: dict[str, Any] = {}
    for prefix, (x, P) in {"": (out.estimate, out.covariance), "smooth_": smooth(out, lag)}.items():
        for name, (dims, values, units) in split(model, x, P).items():
            what = name.removesuffix("_sd").replace("_", " ") + (", standard deviation" if name.endswith("_sd") else "")
            when = f"{lag} frames later" if prefix else "filtered"
            data[prefix + name] = (dims, values, {"units": units, "long_name": f"{what}, {when}"})
    attrs = {"units": "SI", "long_name": "covariance of absolute angles, rates and disturbances"}
    data["state_covariance"] = (("time", "state", "state_2"), out.covariance, attrs)
    data["innovation"] = (("time", "row"), out.innovation, {"units": "1", "long_name": "whitened innovation"})
    data["normalised_innovation_squared"] = ("time", out.score[:, 1], {"units": "1", "long_name": "NIS"})
    data["motion"] = ("time", out.score[:, 3], {"units": "rad2/s2", "long_name": "mean square joint rate of late"})
    data["rows_used"] = ("time", out.score[:, 0].astype(int), {"units": "1", "long_name": "rows of the frame in use"})
    attrs = dict(zip(("units", "long_name"), about_inputs(model.actuation), strict=True))
    data[model.actuation.variable] = (("time", "input"), plan.pressure, attrs)
    tips = mechanics_of(model).tips(out.estimate[:, : model.size])
    data["tip_position"] = (("time", "link", "axis"), tips, {"units": "m", "long_name": "estimated link tips"})
    coords: dict[str, Any] = {
        "time": ("time", measurement.time, {"units": "s", "long_name": "stamp of the frame"}),
        **mechanics_of(model).labels, "link": np.arange(1, model.n + 1), "axis": list("xyz"[: tips.shape[-1]]),
        "row": list(measurement.label), **inputs_of(model),
    }
    return xr.Dataset(data, coords, attrs=judged(measurement, out, noise, model, lag))


def judged(measurement: Measurement, out: FilterOutput, noise: Noise, model: Model, lag: int) -> dict[str, Any]:
    """Return dataset attributes of a filter run: consistency of the innovations, counts of frames, and settings."""
    used = out.score[:, 0]
    settled = np.flatnonzero(used > 0)[1:]  # the first one meets the assumed start
    correlation, bound = whiteness(out.innovation[settled])
    low, high = mean_bounds(used[settled])
    flipped = flips(measurement.rows, measurement.value, out.innovation)
    partly = int(((used > 0) & (used < measurement.value.shape[1])).sum())
    return {
        "schema": "pliant-estimate", "model": model.name, "source": f"pliant {__version__}", "lag_frames": lag,
        "nis_ratio": float(out.score[settled, 1].sum() / used[settled].sum()), "nis_bounds": [low, high],
        "innovation_correlation": correlation, "innovation_correlation_bound": bound,
        "log_likelihood": -0.5 * float(np.sum(out.score[settled, 1] + out.score[settled, 2])),
        "frames": int(used.size), "frames_skipped": int((used == 0).sum()), "frames_in_part": partly,
        "orientations_flipped": flipped,
        "noise_position_m": noise.position, "noise_torque": noise.torque, "noise_random_walk": noise.random_walk,
        "notes": "\n".join(measurement.notes),
    }


def mean_bounds(degrees: Array, level: float = 0.95) -> tuple[float, float]:
    """Return the interval that contains, with probability `level`, the sum of chi-square variables divided by the sum
    of their degrees of freedom.

    A mean of normalised squares, divided by its mean degree, lies between the bounds with probability `level` if the
    covariances are right. Its expected value is 1.
    """
    from scipy.special import gammaincinv  # as chi2.ppf does, without a third of a second for scipy.stats

    total = float(np.sum(degrees))
    if total <= 0:
        raise InputError(
            "consistency needs at least one used value, but no row of any frame was used: check that the recording "
            "holds values that are not NaN"
        )
    low, high = 2.0 * gammaincinv(0.5 * total, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
    return float(low) / total, float(high) / total


def whiteness(innovation: Array) -> tuple[float, float]:
    """Return the correlation between successive whitened innovations (T, m) of m measured values in T frames, and its
    95 % bound for white noise.

    The correlation of white innovations lies within the bound. A larger one means a model error that persists from
    frame to frame.
    """
    left, right = innovation[:-1], innovation[1:]
    both = np.isfinite(left) & np.isfinite(right)
    if both.sum() < 2:
        raise InputError("whiteness needs two consecutive frames without missing values: record with fewer gaps")
    power = 0.5 * float(np.sum(left[both] ** 2) + np.sum(right[both] ** 2))
    common = float(np.sum(left[both] * right[both]))
    return common / power if power else 0.0, 1.96 / float(np.sqrt(both.sum()))


def smooth(out: FilterOutput, lag: int) -> tuple[Array, Array]:
    """Return smoothed states (T, N) and their covariances (T, N, N), for N states in T frames. The estimate of each
    frame also uses the `lag` frames after it.

    x_{k|k+L} = x_k + sum_{j=1..L} C_k ... C_{k+j-1} (x_{k+j} - x^-_{k+j}),  C_k = P_k F_{k+1}^T (P^-_{k+1})^{-1}

    With a lag as long as the recording this is the Rauch-Tung-Striebel smoother of the whole recording.

    Source: Rauch, Tung and Striebel (1965); Sarkka, Bayesian Filtering and Smoothing, Sec. 8.2

    Raises
    ------
    InputError
        When the lag is negative.
    """
    if lag < 0:
        raise InputError(f"the lag must be a number of frames, at least 0, got {lag}")
    x, P = out.estimate.copy(), out.covariance.copy()
    frames = x.shape[0]
    gain = gains(out)
    moved = out.estimate - out.predicted
    learnt = out.covariance - out.predicted_covariance
    product = np.broadcast_to(np.eye(x.shape[1]), P.shape).copy()
    for j in range(1, min(lag, frames - 1) + 1):
        product = product[: frames - j] @ gain[j - 1 :]
        x[: frames - j] += np.einsum("tab,tb->ta", product, moved[j:])
        P[: frames - j] += product @ learnt[j:] @ np.swapaxes(product, 1, 2)
    return x, 0.5 * (P + np.swapaxes(P, 1, 2))


def gains(out: FilterOutput) -> Array:
    """Return the smoother's gain matrices (T - 1, N, N) for N states: one matrix C_k from each of T frames to the next.

    States with zero variance (known, and constant in the model) are scaled by 1 so that the division stays defined.
    """
    forward = out.transition[1:] @ out.covariance[:-1]  # F P, the transpose of P F^T
    ahead = out.predicted_covariance[1:]
    scale = np.sqrt(np.einsum("taa->ta", ahead))
    scale[scale == 0] = 1.0
    unit = ahead / scale[:, :, None] / scale[:, None, :]
    unit = unit + 1e-13 * np.eye(unit.shape[1])
    solved = np.linalg.solve(unit, forward / scale[:, :, None]) / scale[:, :, None]
    return np.asarray(np.swapaxes(solved, 1, 2))
