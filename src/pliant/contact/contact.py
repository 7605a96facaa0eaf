"""The function `find_contact`, which finds when and where something touches the body, and how hard."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from pliant.contact.free_motion import (
    FreeMotion,
    features_of,
    fit_free_motion,
    fit_sudden_test,
    normalised,
    running_mean,
)
from pliant.contact.likelihood_ratio import InnovationResponse, frames_of, innovation_response, likelihood_ratio
from pliant.contact.locate import END, Push, locate
from pliant.errors import InputError
from pliant.estimation.measurement import measurement_of
from pliant.estimation.noise import Noise, default_noise
from pliant.estimation.offline import estimate, input_of
from pliant.mechanics import mechanics_of
from pliant.model import Model
from pliant.simulation import simulate
from pliant.simulation.result import ENDINGS
from pliant.version import __version__

Array = np.ndarray
KEPT = ("pressure", "actuation", "tip_position", *(f"joint_angle{end}" for end in ENDINGS))  # of an estimate
GONE = 2.0  # mean normalised square of the torques, over that of their drift, below which a contact is over
STAYS = 0.01  # of the largest mean square of a contact: residual torque by hysteresis
CALM = 0.107  # s for which the torques must stay below these limits
PACE = 0.2  # relative difference allowed between the frame rates of the recording and of the free motion


def find_contact(
    recording: xr.Dataset,
    model: Model,
    *,
    free: Sequence[xr.Dataset] | FreeMotion,
    false_alarms_per_hour: float = 1.0,
    noise: Noise | None = None,
    friction: float = 0.5,
    torque_error: float = 0.05,
    lasting: bool = False,
    **options: Any,
) -> xr.Dataset:
    """Find when, where and how hard something touches the body, from a recording of its shape and pressure.

    Parameters
    ----------
    recording : xarray.Dataset
        As for `estimate`.
    free : recordings or FreeMotion
        Recordings of the same body without contact, under similar pressures; or the result of `free_motion` for them.
        They set the threshold of the test.
    false_alarms_per_hour : float
        Rate of false alarms for which the threshold is chosen.
    noise : Noise, optional
        As for `estimate`; the disturbance must be a random walk.
    friction : float
        Likely coefficient of friction, which limits the force along the body where the torques do not determine it.
    torque_error : float
        Relative standard deviation of an external torque, from the uncertainty of the joints' stiffness.
    lasting : bool
        Whether to detect slowly growing torques too, by a cumulative sum. This finds a body that is loaded slowly,
        which the test for sudden forces misses, but drifts of sensor and material cause more false alarms.
    **options
        Options of `estimate`: latency, time_step, stations.

    Returns
    -------
    xarray.Dataset
        statistic (threshold 1, higher while the filter still follows a release), in_contact (time), external_torque
        [N m] (time, joint) without the part explained by free motion; for an extensible body also external_axial_force
        [N] (time, segment). While in contact:
        contact_arc_length [m] with arc_low and arc_high (95 %), contact_position [m], contact_normal, contact_force [N]
        (time, axis), force_covariance, normal_force, tangential_force with `_sd`, hidden_tangential (time). In space
        there are three axes, and external_torque_x and external_torque_y. attrs: threshold, alarm times, onset times,
        and properties of the free motion.

    Raises
    ------
    InputError, SimulationError
        As `estimate`; and when there is too little free motion.

    Examples
    --------
    On recordings of your own::

        import pliant
        from pliant.contact import find_contact, free_motion
        model = pliant.load_model("results/arm/model.json")
        free = [pliant.read(name) for name in ("pulse_60.nc", "pulse_119.nc", "pulse_180.nc")]
        learnt = free_motion(free, model, false_alarms_per_hour=1.0)
        touched = find_contact(pliant.read("poke.nc"), model, free=learnt)
        touched.attrs["onset_s"]                                   # times at which contacts begin, s
        at = touched.where(touched.in_contact, drop=True)
        at.contact_arc_length, at.contact_force                    # position along the body, m; force, N
        at.hidden_tangential.any()                                 # whether the force along the body is undetermined
    """
    settings = noise or default_noise(model, recordings=[recording])
    learnt = free if isinstance(free, FreeMotion) else free_motion(
        free, model, false_alarms_per_hour=false_alarms_per_hour, noise=settings, **options
    )
    filtered = filtered_motion(recording, model, settings, options)
    check_frame_rate(filtered.estimated, learnt.period)
    ratio, since = likelihood_ratio(learnt.sudden.answer, model, *filtered.innovations)
    left = learnt.left_over(filtered.torque, filtered.features)
    slow = learnt.statistic(left, filtered.features) / learnt.threshold if lasting else np.zeros(len(left))
    fast = learnt.sudden.statistic(ratio, filtered.motion)
    scale, pushes = learnt.scale(filtered.features), {}
    events = episodes(slow, fast, since, left, learnt, scale)
    touching = np.zeros(len(left), dtype=bool)
    for event in events:
        touching[event.alarm : event.end] = True
        left[event.onset : event.end] -= event.before
    for k in map(int, np.flatnonzero(touching)):
        covariance = scale[k] * learnt.change + np.diag((torque_error * left[k]) ** 2)
        pushes[k] = locate(model, filtered.angle[k], left[k], covariance, friction=friction)
    return described(filtered, external(model, left), np.maximum(slow, fast), touching, pushes, learnt, events)


def free_motion(
    recordings: Sequence[xr.Dataset], model: Model, *, false_alarms_per_hour: float = 1.0, noise: Noise | None = None,
    **options: Any,
) -> FreeMotion:
    """Return the statistics of the external joint torques in recordings without contact, and the thresholds of the
    contact tests.

    The result holds the thresholds of both tests of `find_contact`: for sudden forces, and for lasting torques. The
    arguments are those of `find_contact`.
    """
    if not recordings:
        raise InputError(
            "free_motion needs at least one recording without contact, which sets the threshold: record some seconds "
            "of free motion"
        )
    settings = noise or default_noise(model, recordings=recordings)
    return free_motion_for_rate(filtered_free_motion(recordings, model, settings, **options), false_alarms_per_hour)


class FilteredFreeMotion(NamedTuple):
    """Results of the state filter for recordings without contact. Thresholds for any rate of false alarms are computed
    from them.
    """

    parts: list[FilteredMotion]
    answer: InnovationResponse
    ratios: list[Array]  # (T,) of each recording


def filtered_free_motion(
    recordings: Sequence[xr.Dataset], model: Model, noise: Noise, **options: Any,
) -> FilteredFreeMotion:
    """Run the state filter over recordings without contact. Return its results, from which the thresholds of the
    contact tests are computed.
    """
    parts = [filtered_motion(r, model, noise, options) for r in recordings]
    measurement = measurement_of(recordings[0], model, noise, options.get("stations"))
    step = min(part.estimated.attrs["step_s"] for part in parts)
    answer = innovation_response(model, noise, measurement, time_step=step)
    for part in parts:
        check_frame_rate(part.estimated, answer.period)
    return FilteredFreeMotion(parts, answer, [likelihood_ratio(answer, model, *p.innovations)[0] for p in parts])


def free_motion_for_rate(filtered: FilteredFreeMotion, rate: float) -> FreeMotion:
    """Return the statistics of motion without contact, and thresholds at which each of the two contact tests (for
    sudden forces, for lasting torques) gives `rate` false alarms per hour.
    """
    parts = filtered.parts
    sudden = fit_sudden_test(filtered.answer, filtered.ratios, [p.motion for p in parts], rate)
    return fit_free_motion([p.torque for p in parts], [p.features for p in parts], sudden, rate=rate)


def check_frame_rate(estimated: xr.Dataset, period: float) -> None:
    """Raise InputError if a recording's frame rate differs from the one for which the thresholds were computed."""
    dt = float(np.median(np.diff(estimated["time"].values)))
    if abs(dt / period - 1.0) > PACE:
        raise InputError(
            f"free motion was recorded at {1 / period:.0f} Hz, but this recording at {1 / dt:.0f} Hz: the threshold "
            "holds for one frame rate, so record both at the same rate"
        )


class FilteredMotion(NamedTuple):
    """Results of the state filter for a recording: the external joint torques and the other inputs of the contact
    tests.
    """

    estimated: xr.Dataset
    torque: Array  # (T, n) N m, disturbance; (T, n + S) for an extensible body, with its strains last
    features: Array  # (T, F), see `features_of`
    angle: Array  # (T, n) rad, of the links, followed by strains
    motion: Array  # (T,) rad^2/s^2

    @property
    def innovations(self) -> tuple[Array, Array, Array]:
        """Return the inputs of the test for sudden forces in each frame: the innovations of the filter, the mean square
        joint rate and the link angles.
        """
        return self.estimated["innovation"].values, self.motion, self.angle


def filtered_motion(recording: xr.Dataset, model: Model, noise: Noise, options: dict[str, Any]) -> FilteredMotion:
    """Run the state filter on a recording. Return the external joint torques that it estimates, and regressors that
    predict the model's own error in these torques.
    """
    if not noise.random_walk > 0:
        raise InputError(
            "noise.random_walk must be positive, since contact is detected in disturbance torques, which are modelled "
            "as a random walk: set it above 0, or leave noise out"
        )
    estimated = estimate(recording, model, noise=noise, **options)
    source, body = input_of(recording, model, options.get("pressure"), options.get("pressure_window", 8e-3),
                            options.get("drive"))
    times = estimated["time"].values - options.get("latency", 0.0)
    run = simulate(body, source, times=times, time_step=estimated.attrs["step_s"], check=False)
    chain, inputs = mechanics_of(model), estimated[model.actuation.variable].values
    features = features_of(model, times, inputs, chain.gathered(run, 0), chain.gathered(run, 1))
    torque, x = chain.gathered(estimated, 2) * chain.lever, chain.coordinates(chain.gathered(estimated, 0))
    return FilteredMotion(estimated, torque, features, x, estimated["motion"].values)


class ContactEvent(NamedTuple):
    """One contact, with three frame indices: its first frame, the frame of its alarm, and the frame after its last one.
    It also holds the joint torques [N m] before the contact, which are subtracted from those during the contact.
    """

    onset: int
    alarm: int
    end: int
    before: Array


def episodes(
    slow: Array, fast: Array, since: Array, left: Array, learnt: FreeMotion, scale: Array
) -> list[ContactEvent]:
    """Return the contacts in order of time. Each is detected by an alarm, and ends when the external torques have been
    nearly zero for several frames.

    After a contact the filter still shows its changes of force, such as the release. The root of the statistic is a
    norm of the innovations, so without a new force it is at most 1, the threshold, plus the root of this echo.

    The torques before the onset are subtracted, reduced by their correlation over time; the limit for the end grows
    with the drift of free motion since then. Hysteresis leaves a small fraction of the largest torques, which counts as
    vanished.
    """
    mean, events, k = running_mean(left, learnt.period), [], 0
    calm, limit = frames_of(CALM, learnt.period), np.ones(len(left))
    while k < len(left):
        sudden = fast[k] > limit[k]
        if not (sudden or (slow[k] > 1.0 >= slow[max(k - 1, 0)])):
            k += 1
            continue
        onset = max(k + 1 - int(since[k]), 0) if sudden else last_zero(slow, k)
        before = learnt.kept * mean[max(onset - 2, 0)] if onset > 2 else np.zeros(left.shape[1])
        power = normalised(left[k:] - before, learnt.change) / scale[k:]
        drifted = GONE * learnt.drift(np.arange(k, len(left)) - onset)
        there = power > np.maximum(drifted, STAYS * np.maximum.accumulate(power))
        quiet = np.convolve(~there, np.ones(calm), mode="full")[: len(there)]
        gone = np.flatnonzero(quiet[calm:] >= calm) + calm
        end = k + int(gone[0]) if gone.size else len(left)
        events.append(ContactEvent(onset, k, end, before))
        echo = learnt.sudden.answer.echo(fast[k:end])[: len(left) - end]
        limit[end : end + len(echo)] = np.maximum(limit[end : end + len(echo)], (1.0 + np.sqrt(echo)) ** 2)
        k = end
    return events


def last_zero(sums: Array, k: int) -> int:
    """Return the index of the first frame after a cumulative sum was last zero, at or before frame k. Return 0 if it
    was never zero.
    """
    zeros = np.flatnonzero(sums[: k + 1] <= 0)
    return int(zeros[-1]) + 1 if zeros.size else 0


def external(model: Model, left: Array) -> dict[str, Any]:
    """Return the joint torques (T, n) [N m] of n joints and the axial forces (T, S) [N] of S segments that contact
    causes in T frames, as variables for a dataset.
    """
    return {
        kind.names[3]: (("time", kind.over), left[:, kind.rows] / kind.lever, {"units": kind.units[2]})
        for kind in mechanics_of(model).kinds
    }


def described(
    filtered: FilteredMotion, left: dict[str, Any], statistic: Array, touching: Array, pushes: dict[int, Push],
    learnt: FreeMotion, events: list[ContactEvent],
) -> xr.Dataset:
    """Return the dataset of `find_contact`: state, contact flag, position and force of the contact in each frame."""
    estimated = filtered.estimated
    T, axes = statistic.size, estimated.sizes["axis"]
    numbers = {
        "contact_arc_length": "m", "arc_low": "m", "arc_high": "m", "normal_force": "N", "normal_force_sd": "N",
        "tangential_force": "N", "tangential_force_sd": "N",
    }
    columns: dict[str, Array] = {name: np.full(T, np.nan) for name in numbers}
    vectors = {name: np.full((T, axes), np.nan) for name in ("contact_position", "contact_force", "contact_normal")}
    covariance, hidden = np.full((T, axes, axes), np.nan), np.zeros(T, dtype=bool)
    for k, p in pushes.items():
        values = (p.arc_length, *p.arc_interval, p.normal, p.normal_sd, p.tangential, p.tangential_sd)
        for name, value in zip(numbers, values, strict=True):
            columns[name][k] = value
        vectors["contact_position"][k], vectors["contact_force"][k] = p.position, p.force
        vectors["contact_normal"][k] = np.sign(p.normal) * p.left
        if p.arc_interval[1] > p.end - END and not p.hidden:  # the end is round: it touches where it is pushed
            vectors["contact_normal"][k] = p.force / np.linalg.norm(p.force)
        covariance[k], hidden[k] = p.covariance, "tangential" in p.hidden
    clock = estimated["time"].values
    data: dict[str, Any] = {name: ("time", columns[name], {"units": unit}) for name, unit in numbers.items()}
    data |= {name: (("time", "axis"), v, {"units": "N" if "force" in name else "m"}) for name, v in vectors.items()}
    data |= {
        "force_covariance": (("time", "axis", "axis_2"), covariance, {"units": "N2"}),
        "hidden_tangential": ("time", hidden), "in_contact": ("time", touching), "statistic": ("time", statistic),
        **left,
        **{name: estimated[name] for name in KEPT if name in estimated},
    }
    return xr.Dataset(data, estimated.coords, {
        "schema": "pliant-contact", "source": f"pliant {__version__}", "model": estimated.attrs["model"],
        "threshold": 1.0, "false_alarms_per_hour": learnt.rate, "free_motion_s": learnt.duration,
        "threshold_extrapolated": int(learnt.extrapolated), "onset_s": [float(clock[e.onset]) for e in events],
        "alarm_s": [float(clock[e.alarm]) for e in events], "frames_skipped": estimated.attrs["frames_skipped"],
    })
