"""Settled poses of a robot with tendons, and of a tentacle: what the example studies find predicts poses not fitted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pliant.identification.prediction import predict
from pliant.study import load_study
from pliant.study.run import prepare_all

ROOT = Path(__file__).resolve().parents[2]
ROBOT = {  # found by the study's fit to twelve blocks of poses
    "stiffness": 0.01054, "base_x": -0.0002016, "base_y": -0.001413, "base_z": -0.005163, "base_tilt_x": -0.05324,
    "base_tilt_y": -0.01338, "tip.along": 0.02256, "tip.across": -0.0004217, "tip.aside": 4.188e-05,
    "t1.pretension": 0.02294, "t1.gain_x": 0.103, "t1.gain_y": -0.9598, "t2.pretension": 0.04978,
    "t2.gain_x": 0.802, "t2.gain_y": 0.6193, "t3.pretension": -0.1045, "t3.gain_x": -0.9628, "t3.gain_y": 0.4287,
    "t4.pretension": 0.002882, "t4.gain_x": 0.5326, "t4.gain_y": -0.8207, "t5.pretension": 0.2382,
    "t5.gain_x": 0.4193, "t5.gain_y": 0.9525, "t6.pretension": 0.06132, "t6.gain_x": -1.102, "t6.gain_y": -0.06798,
    "t7.pretension": 0.24, "t7.gain_x": 0.8602, "t7.gain_y": -0.4945, "t8.pretension": 0.3437,
    "t8.gain_x": -0.03032, "t8.gain_y": 0.9715, "t9.pretension": 0.4633, "t9.gain_x": -0.9503, "t9.gain_y": -0.5152,
}
TENTACLE = {  # found by the study's fit to all eight poses
    "friction": 0.245, "taper": 0.02541, "body_stiffness": 0.4048, "mass": 0.1655, "m1.gain_x": -0.4838,
    "m1.gain_y": 0.8506, "m2.gain_x": -0.5107, "m2.gain_y": -0.8845, "base_x": -0.004376, "base_y": 0.0009582,
    "base_z": 0.007035, "base_tilt_x": -0.005118, "base_tilt_y": 0.01113, "base_tilt_z": -0.05337,
    "p1.along": 0.006264, "p1.across": -0.02661, "p1.aside": -0.0009802, "p2.along": 0.009728, "p2.across": 0.01996,
    "p2.aside": 0.001088, "p3.along": 0.01752, "p3.across": -0.01918, "p3.aside": -0.001932, "tip.along": 0.02429,
    "tip.across": 0.003313, "tip.aside": -0.001788,
}


def prepared(shared_data, name, recordings, **tendon):
    """Some recordings of an example study, and its model."""
    study = load_study(ROOT / "examples" / f"{name}.toml")
    kept = {
        key: study.recordings[key].model_copy(
            update={"file": str(shared_data / name / Path(study.recordings[key].file).name)}
        )
        for key in recordings
    }
    fit = next(iter(study.fits.values())).model_copy(update={"train": recordings[:1], "held_out": recordings[1:]})
    tendons = [t.model_copy(update=tendon) for t in study.actuator.tendons]
    actuator = study.actuator.model_copy(update={"tendons": tendons})
    made = study.model_copy(update={"recordings": kept, "fits": {"one": fit}, "actuator": actuator})
    return prepare_all(made, lambda _line: None)


def error(ready, values):
    """Root mean square distance over all poses and stations, m."""
    off = [predict(ready.model, e, values, 1e-3)["position"] - e.position for e in ready.experiments.values()]
    return np.sqrt(np.mean(np.concatenate([np.sum(o**2, axis=-1).ravel() for o in off])))


@pytest.mark.slow
def test_blocks_of_poses_that_the_fit_did_not_see_are_predicted(shared_data):
    ready = prepared(shared_data, "spatial_tendon_robot", ["b3", "b9", "b15"], azimuth_deg=0.0)
    model = ready.model.with_(stations=[ready.model.points[-1]._replace(name="tip", link=5)])
    assert sum(e.time.size for e in ready.experiments.values()) == 270
    alone = error(ready._replace(model=model), ROBOT)
    assert alone < 6e-3
    trailing = error(ready._replace(model=model), ROBOT | {"entry_friction": 0.04})
    assert trailing < 0.97 * alone  # the tip trails
    guided = error(ready._replace(model=model), ROBOT | {"entry_friction": 0.05, "spacing": 0.02})
    assert guided < 0.9 * trailing  # discs at each third of a segment


@pytest.mark.slow
def test_eight_poses_of_a_tentacle_are_followed_by_one_modulus(shared_data):
    poses = [f"m{motor}_u{level}" for motor in (1, 2) for level in ("01", "015", "02", "025")]
    ready = prepared(shared_data, "spatial_tentacle", poses)
    assert error(ready, TENTACLE) < 5.0e-3
    assert error(ready, TENTACLE | {"friction": 0.0}) > 14e-3
