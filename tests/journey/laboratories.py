"""Ten laboratories that record the same arm, each in its habits, and the study that a person who knows the arm writes.

The arm moves in MuJoCo (`arm_in_mujoco`); every file is made here, by code. The study by hand reads the same numbers
from tables of pliant's own, states the true structure, gravity and mounting, and frees what nobody can measure.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import arm_in_mujoco as arm
import numpy as np
from arm_in_mujoco import DOWN, LENGTH, LEVER, MASS, ORIGIN, ROOM, Motion, in_room, in_room_turned
from small_study import write_recording

Array = np.ndarray
PSI = 6894.757293168361  # Pa
LEVELS = {"one": 3e4, "two": 4.5e4, "three": 6e4}  # Pa
BODY = {"length": LENGTH, "mass": MASS, "links": 6, "joint_placement": "midsegment", "gravity": DOWN.tolist()}
MOUNTED = {"base": "base", "tangent": ROOM.apply([0.0, 0.0, 1.0]).tolist()}
NOISE = 1e-4  # m


class Laboratory(NamedTuple):
    """Files of a laboratory; for the study by hand tables by the names of the draft's recordings, and what differs."""

    files: list[Path]
    tables: dict[str, tuple[list[str], Array]]
    study: dict[str, Any]


def lines(path: Path, rows: list[str], encoding: str = "utf-8") -> Path:
    path.write_text("\n".join([*rows, ""]), encoding=encoding)
    return path


def pulse(level: float, rate: float = 50.0) -> Motion:
    return arm.pushed(((0.4, level), (1.7, 0.0)), rate=rate)


def steps(seed: int, largest: float, rate: float = 50.0) -> Motion:
    """Steps to random levels [Pa] every 0.4 to 0.8 s."""
    rng = np.random.default_rng(seed)
    begins = 0.4 + np.cumsum(rng.uniform(0.4, 0.8, 6))
    levels = np.round(largest * np.append(rng.uniform(0.0, 1.0, 5), 0.0), -2)
    return arm.pushed(tuple(zip(begins.tolist(), levels.tolist(), strict=True)), duration=5.0, rate=rate)


def wide(motion: Motion, points: Array, names: tuple[str, ...], inputs: str = "p_Pa") -> tuple[list[str], Array]:
    """Names and columns of pliant's own table."""
    head = ["t", *([inputs] if inputs else []), *(f"{axis}_{name}" for name in names for axis in "xyz")]
    columns = [motion.time[:, None], *([motion.inputs] if inputs else []), points.reshape(len(points), -1)]
    return head, np.hstack(columns)


def planar(*places: float, **more: Any) -> dict[str, Any]:
    """The study by hand of a body that one chamber bends in a plane, with stations at fractions of its length."""
    names = [f"s{k}" for k in range(1, len(places))] + ["tip"]
    stations = [{"name": n, "at": LENGTH * p} for n, p in zip(names, places, strict=True)]
    return {"actuator": {**BODY, "stations": stations}, "alignment": {"options": MOUNTED},
            "parameters": ["stiffness", "damping", "torque_1", "torque_2", "base_angle"], **more}  # fmt: skip


def by_hand(laboratory: Laboratory, folder: Path, train: list[str], held_out: list[str]) -> dict[str, Any]:
    """Write the tables and return the content of the study by hand, with the split of the draft."""
    study = laboratory.study
    for name, (head, columns) in laboratory.tables.items():
        write_recording(folder / f"{name}.csv", columns, head)
    own = study.get("recordings", {})
    return {
        "name": "by_hand", "actuator": study["actuator"], "alignment": study["alignment"],
        "mapping": study.get("mapping", {}),
        "recordings": {name: {"file": f"{name}.csv", **own.get(name, {}), **own.get("all", {})}
                       for name in laboratory.tables},
        "fits": {"only": {"train": train, "held_out": held_out,
                          "parameters": study["parameters"] if isinstance(study["parameters"], dict)
                          else dict.fromkeys(study["parameters"], "free")}},
    }  # fmt: skip


def vrpn(folder: Path) -> Laboratory:
    """A VRPN client writes one body with zeros where it is lost; a data logger writes psi on a clock of its own."""
    files, tables = [], {}
    for k, (word, level) in enumerate(LEVELS.items()):
        motion, name = pulse(level), f"arm_{word}"
        tip, turn = in_room(motion.at(1.0), NOISE, k)[:, 0], in_room_turned(motion.turn(1.0), seed=k)
        tip[[60, 61, 62, 120]], turn[[60, 61, 62, 120]] = 0.0, 0.0
        rows = [f"{1_771_000_000 + 977 * k + t:.4f},Tracker0,{','.join(f'{v:.6f}' for v in (*p, *q))}"
                for t, p, q in zip(motion.time, tip, turn, strict=True)]  # fmt: skip
        files.append(lines(folder / f"{name}.csv", ["timestamp,tracker,x,y,z,qx,qy,qz,qw", *rows]))
        log = [f"{1e3 * t + 2204.0:.1f},60.1,{p / PSI:.4f}"
               for t, p in zip(motion.time, motion.inputs[:, 0], strict=True)]  # fmt: skip
        files.append(lines(folder / f"{name}_daq.csv", ["elapsed (ms),supply (psi),chamber (psi)", *log]))
        tip[[60, 61, 62, 120]] = np.nan
        base = np.tile(ORIGIN, (len(tip), 1))
        tables[name] = wide(motion, np.stack([base, tip], axis=1), ("base", "tip"))
    return Laboratory(files, tables, planar(1.0))


def motive(folder: Path) -> Laboratory:
    """Motive in metres: rigid bodies at the plate (found late) and the tip, unlabelled markers; counts in TDMS."""
    from nptdms import ChannelObject, TdmsWriter

    files, tables = [], {}
    for k, level in enumerate(LEVELS.values()):
        motion, n, name = pulse(level), 151, f"Take_{k + 1:03d}"
        base, tip = in_room(np.zeros((n, 3)), 2e-5, 10 + k), in_room(motion.at(1.0)[:, 0], NOISE, k)
        turns = np.tile(ROOM.as_quat(), (n, 1)), in_room_turned(motion.turn(1.0), seed=k)
        base[:8], turns[0][:8] = np.nan, np.nan
        stray = np.full((n, 6), np.nan)
        stray[30:90, :3], stray[100:, 3:] = tip[30:90] + np.array([0.01, 0.0, 0.02]), 1.5
        blocks = [("Rigid Body", "Plate", 7), ("Rigid Body", "Gripper", 7), ("Marker", "Unlabeled 3021", 3),
                  ("Marker", "Unlabeled 3022", 3)]  # fmt: skip
        kinds = [kind for kind, _, w in blocks for _ in range(w)]
        names = [label for _, label, w in blocks for _ in range(w)]
        roles = [r for _, _, w in blocks for r in (["Rotation"] * 4 + ["Position"] * 3 if w == 7 else ["Position"] * 3)]
        axes = [a for _, _, w in blocks for a in ("XYZWXYZ" if w == 7 else "XYZ")]
        about = (f"Format Version,1.24,Take Name,{name},Capture Frame Rate,50.000000,Export Frame Rate,50.000000,Total "
                 f"Frames in Take,{n},Total Exported Frames,{n},Rotation Type,Quaternion,Length Units,Meters,"
                 "Coordinate Space,Global")  # fmt: skip
        head = [about, "", ",Type," + ",".join(kinds), ",Name," + ",".join(names),
                ",ID," + ",".join(names), ",," + ",".join(roles), "Frame,Time (Seconds)," + ",".join(axes)]  # fmt: skip
        values = np.hstack([turns[0], base, turns[1], tip, stray])
        rows = [f"{i},{motion.time[i]:.6f}," + ",".join("" if np.isnan(v) else f"{v:.6f}" for v in row)
                for i, row in enumerate(values)]  # fmt: skip
        files.append(lines(folder / f"{name}.csv", [*head, *rows]))
        counts = np.round(motion.inputs[:, 0] / 20.0 + 400.0).astype(np.int16)
        channel = ChannelObject("Dev1", "ai3", counts, properties={"wf_start_offset": 0.0, "wf_increment": 0.02})
        files.append(folder / f"daq_{k + 1:03d}.tdms")
        with TdmsWriter(files[-1]) as writer:
            writer.write_segment([channel])
        tables[name] = wide(motion, np.stack([base, tip], axis=1), ("base", "tip"))
    late = {"alignment": {"options": {"rest": [0.18, 0.38]}}}
    return Laboratory(files, tables, planar(1.0, recordings={"all": late}))


def poses(folder: Path) -> Laboratory:
    """A table a pose, named by cable and weight; its four markers are in any order, one of them on the plate."""
    files, tables, rng = [], {}, np.random.default_rng(4)
    tendons = [{"name": f"cable{c + 1}", "driven_by": "tension", "lever": LEVER,
                "azimuth_deg": float(np.degrees(arm.TOWARDS[c]))} for c in range(3)]  # fmt: skip
    recordings = {}
    for cable in range(3):
        for newton in (1.0, 2.0, 3.0):
            name, places = f"cable{cable + 1}_{newton:.1f}N", (0.0, 1 / 3, 2 / 3, 1.0)
            row = tuple(newton if c == cable else 0.0 for c in range(3))
            points = arm.settled((row,)).at(*places)[0]
            frames = in_room(np.repeat(points[None], 40, axis=0), NOISE, int(10 * newton) + 50 * cable)
            order = rng.permutation(4)
            rows = [f"{k},{k / 100:.2f}," + ",".join(f"{1e3 * v:.3f}" for v in frame[order].ravel())
                    for k, frame in enumerate(frames)]  # fmt: skip
            head = "frame,time_s," + ",".join(f"M{m + 1}_{a}_mm" for m in range(4) for a in "xyz")
            files.append(lines(folder / f"{name}.csv", [head, *rows]))
            names = ("base", "s1", "s2", "tip")
            motion = Motion(np.arange(40) / 100, np.zeros((40, 1)), frames, frames)
            tables[name.replace(".", "_")] = wide(motion, frames, names, inputs="")
            recordings[name.replace(".", "_")] = {"poses": "median", "inputs": {f"cable{cable + 1}": newton}}
    stations = [{"name": n, "at": LENGTH * p} for n, p in zip(("s1", "s2", "tip"), (1 / 3, 2 / 3, 1.0), strict=True)]
    study = {"actuator": {**BODY, "space": True, "tendons": tendons, "stations": stations},
             "alignment": {"options": {**MOUNTED, "plane": ROOM.apply([1.0, 0.0, 0.0]).tolist()}},
             "parameters": ["stiffness"], "recordings": recordings}  # fmt: skip
    return Laboratory(files, tables, study)


def sessions(folder: Path) -> Laboratory:
    """Three sessions of settled poses without header or time: the tip [mm], then the microsteps of three motors."""
    files, tables, rng = [], {}, np.random.default_rng(9)
    for session in "ABC":
        counts = rng.integers(-500, 500, (40, 3))
        drums = counts * 2.0 * np.pi / 3200.0 * 0.012  # m, 3200 microsteps a turn of drums of 12 mm
        motion = arm.settled(tuple(map(tuple, drums.tolist())), displaced=True)
        tip = in_room(motion.at(1.0), NOISE, ord(session))[:, 0]
        rows = [",".join([*(f"{1e3 * v:.2f}" for v in p), *map(str, c)]) for p, c in zip(tip, counts, strict=True)]
        files.append(lines(folder / f"session_{session}.csv", rows))
        points = np.stack([np.tile(ORIGIN, (len(tip), 1)), tip], axis=1)
        head, columns = wide(motion, points, ("base", "tip"), inputs="")
        tables[f"session_{session}"] = [*head, *(f"u{c}_m" for c in range(3))], np.hstack([columns, drums])
    tendons = [{"name": f"u{c}", "driven_by": "displacement", "lever": LEVER, "line_stiffness": arm.LINE,
                "pretension": 1.0, "azimuth_deg": float(np.degrees(arm.TOWARDS[c]))} for c in range(3)]  # fmt: skip
    mapping = {"header": True, "time": "t", "length_unit": "m", "inputs": {
        "columns": [f"u{c}_m" for c in range(3)], "kind": "displacement", "unit": "m", "names": ["u0", "u1", "u2"]},
        "stations": {s: {"position": [f"{a}_{s}" for a in "xyz"]} for s in ("base", "tip")}}  # fmt: skip
    study = {"actuator": {**BODY, "space": True, "tendons": tendons, "stations": [{"name": "tip", "at": LENGTH}]},
             "alignment": {"options": {**MOUNTED, "plane": ROOM.apply([1.0, 0.0, 0.0]).tolist(), "rest": [0.0, 0.0]}},
             "mapping": mapping, "parameters": ["stiffness"],
             "recordings": {"all": {"poses": True, "drive": {f"u{c}": f"u{c}" for c in range(3)}}}}  # fmt: skip
    return Laboratory(files, tables, study)


def matlab(folder: Path) -> Laboratory:
    """One MATLAB file, a cell of trials of random steps: markers (S x 3 x T) in mm, the pressure in psi."""
    from scipy.io import savemat

    trials, tables, places = np.empty(3, object), {}, (0.0, 0.5, 1.0)
    for k in range(3):
        motion = steps(k, (4.5e4, 6e4, 6e4)[k])
        motion = motion.thinned(np.arange(len(motion.time) - 7 * k))
        points = in_room(motion.at(*places), NOISE, k)
        trials[k] = {"time": motion.time, "markers": 1e3 * points.transpose(1, 2, 0), "subject": "arm 7",
                     "pressure": motion.inputs[:, 0] / PSI}  # fmt: skip
        tables[f"bench_{k + 1}"] = wide(motion, points, ("base", "s1", "tip"))
    savemat(folder / "bench.mat", {"experiments": trials})
    return Laboratory([folder / "bench.mat"], tables, planar(0.5, 1.0))


def bag(folder: Path) -> Laboratory:
    """Folders of ROS 2 bags: the orientation of an inertial sensor at the tip, and an absolute pressure."""
    import rosbags.rosbag2 as rosbags
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types, files, tables = store.types, [], {}
    for k, (word, level) in enumerate(LEVELS.items()):
        motion, path = pulse(level), folder / f"trial_{word}"
        turn = in_room_turned(motion.turn(1.0), seed=k)
        with rosbags.Writer(path, version=8) as writer:
            imu, fluid = (writer.add_connection(topic, kind, typestore=store) for topic, kind in (
                ("/tip/imu/data", "sensor_msgs/msg/Imu"), ("/regulator", "sensor_msgs/msg/FluidPressure")))  # fmt: skip
            for i, t in enumerate(motion.time):
                ns = 1_772_000_000 * 10**9 + round(1e9 * t)
                header = types["std_msgs/msg/Header"](
                    stamp=types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9), frame_id="tip")
                vector, nine = types["geometry_msgs/msg/Vector3"], np.zeros(9)
                message = types[imu.msgtype](
                    header=header, orientation=types["geometry_msgs/msg/Quaternion"](*turn[i]),
                    orientation_covariance=nine, angular_velocity=vector(0.0, 0.0, 0.0),
                    angular_velocity_covariance=nine, linear_acceleration=vector(0.0, 0.0, 9.8),
                    linear_acceleration_covariance=nine,
                )  # fmt: skip
                writer.write(imu, ns, store.serialize_cdr(message, imu.msgtype))
                air = types[fluid.msgtype](header=header, fluid_pressure=motion.inputs[i, 0] + 100_900.0, variance=0.0)
                writer.write(fluid, ns + 10**6, store.serialize_cdr(air, fluid.msgtype))
        files.append(path)
        across = ROOM.apply([-np.sin(arm.PLANE), np.cos(arm.PLANE), 0.0])  # the axis about which the body bends
        relative = arm.Rotation.from_quat(turn) * ROOM.inv()
        angle = np.degrees(relative.as_rotvec() @ across)
        tables[path.name] = ["time", "angle", "pressure"], np.column_stack([motion.time, angle, motion.inputs[:, 0]])
    study = {"actuator": {**BODY, "links": 3, "gravity": [0.0, 9.81]}, "alignment": {},
             "mapping": {"angle_unit": "deg", "pressure_unit": "Pa"},
             "parameters": ["stiffness", "damping", "torque_1", "torque_2"]}  # fmt: skip
    return Laboratory(files, tables, study)


def film(folder: Path) -> Laboratory:
    """DeepLabCut's table of points in pixels of a film from the side, and a table of typed steps [mbar]."""
    files, tables = [], {}
    for k, scale in enumerate((0.5, 0.75, 1.0)):
        begins, typed = (0.4, 1.3, 2.0, 3.1), [round(600 * scale * f) for f in (1.0, 0.4, 0.8, 0.0)]
        motion = arm.pushed(tuple((b, 100.0 * p) for b, p in zip(begins, typed, strict=True)), duration=4.0, rate=40.0)
        points = motion.at(0.0, 0.5, 1.0)
        out = points[..., 0] * np.cos(arm.PLANE) + points[..., 1] * np.sin(arm.PLANE)
        side = np.stack([out, points[..., 2]], axis=-1)
        side = side + NOISE * np.random.default_rng(k).standard_normal(side.shape)
        pixels = np.array([820.0, 95.0]) + 3200.0 * side  # downwards, as the arm hangs; 3.2 pixels a mm
        parts, name = ("clamp", "middle", "tip"), f"film_{'abc'[k]}"
        head = ["scorer," + ",".join(["net"] * 9), "bodyparts," + ",".join(p for p in parts for _ in range(3)),
                "coords," + ",".join(["x", "y", "likelihood"] * 3)]  # fmt: skip
        rows = [f"{i}," + ",".join(f"{x:.3f},{y:.3f},0.99" for x, y in frame) for i, frame in enumerate(pixels)]
        files.append(lines(folder / f"{name}.csv", [*head, *rows]))
        table = [f"{t:.2f};{p}" for t, p in zip((0.0, *begins), (0, *typed), strict=True)]
        files.append(lines(folder / f"{name}_steps.csv", ["time (s);set pressure (mbar)", *table]))
        places = np.stack([-side[..., 0], -side[..., 1], 0 * side[..., 0]], axis=-1)
        level = np.array([0, *typed])[np.searchsorted(begins, motion.time, side="left")]  # as typed
        tables[name] = wide(motion._replace(inputs=100.0 * level[:, None]), places, ("base", "s1", "tip"))
    study = planar(0.5, 1.0)
    study["parameters"] = {**dict.fromkeys(study["parameters"], "free"), "valve_rise_time": {"value": 0.02},
                           "valve_fall_time": {"value": 0.02}}  # fmt: skip
    study["alignment"] = {"options": {"base": "base", "tangent": [0.0, -1.0, 0.0]}}
    study["actuator"]["gravity"] = [0.0, -9.81, 0.0]
    return Laboratory(files, tables, study)


def coils(folder: Path) -> Laboratory:
    """Electromagnetic coils with a word for their status, decimal commas; counts of the encoder of a tendon's motor."""
    files, tables = [], {}
    for k, word in enumerate(("low", "mid", "high")):
        scale = (0.5, 0.75, 1.0)[k]
        motion = arm.tugged(tuple((b, 0.012 * scale * f) for b, f in ((0.4, 1.0), (1.3, 0.4), (2.0, 0.8), (3.1, 0.0))),
                            duration=4.0, rate=40.0)  # fmt: skip
        points = in_room(motion.at(0.0, 1.0), NOISE, k)
        counts = np.round(motion.inputs[:, 0] / 0.015 * 4096.0 / (2.0 * np.pi)).astype(int)  # 4096 a turn, pulley 15 mm
        lost = slice(70, 74)
        rows = []
        for i, (base, tip) in enumerate(points):
            cells = [*(f"{1e3 * v:.2f}" for v in base), "OK", *(f"{1e3 * v:.2f}" for v in tip), "OK", str(counts[i])]
            if 70 <= i < 74:
                cells[4:8] = ["-3,7E28"] * 3 + ["MISSING"]
            rows.append(";".join([f"{motion.time[i]:.3f}", *cells]).replace(".", ","))
        named = [name for c in (1, 2) for name in (*(f"Coil{c}_{a} [mm]" for a in "XYZ"), f"Coil{c}_Status")]
        head = ";".join(["Time [s]", *named, "Enc1"])
        files.append(lines(folder / f"em_{word}.csv", [head, *rows]))
        points[lost, 1] = np.nan
        head, columns = wide(motion, points, ("base", "tip"), inputs="")
        tables[f"em_{word}"] = [*head, "u_m"], np.hstack([columns, motion.inputs])
    tendon = {"name": "Enc1", "driven_by": "displacement", "lever": LEVER, "line_stiffness": arm.LINE,
              "azimuth_deg": 90.0}  # fmt: skip
    mapping = {"header": True, "time": "t", "length_unit": "m",
               "inputs": {"columns": ["u_m"], "kind": "displacement", "unit": "m", "names": ["Enc1"]},
               "stations": {s: {"position": [f"{a}_{s}" for a in "xyz"]} for s in ("base", "tip")}}  # fmt: skip
    study = {"actuator": {**BODY, "space": True, "tendons": [tendon], "stations": [{"name": "tip", "at": LENGTH}]},
             "alignment": {"options": {**MOUNTED, "plane": ROOM.apply([1.0, 0.0, 0.0]).tolist()}}, "mapping": mapping,
             "parameters": ["stiffness", "damping"]}  # fmt: skip
    return Laboratory(files, tables, study)


def bars(folder: Path) -> Laboratory:
    """Bars between and behind the cells, units in a row of their own; the base's quaternion jumps by half a turn."""
    files, tables = [], {}
    for k, (word, level) in enumerate(LEVELS.items()):
        motion, name = pulse(level), f"bench_{word}"
        base, tip = in_room(np.zeros((151, 3)), 2e-5, 20 + k), in_room(motion.at(1.0)[:, 0], NOISE, k)
        turn = np.tile(ROOM.as_quat(), (151, 1))
        turn[66:95] = (ROOM * arm.Rotation.from_rotvec([0.0, 0.0, np.pi])).as_quat()
        turn[::3] *= -1.0
        head = "t|base_x|base_y|base_z|base_qw|base_qx|base_qy|base_qz|tip_x|tip_y|tip_z|pressure|"
        units = "ms|cm|cm|cm|-|-|-|-|cm|cm|cm|bar|"
        rows = ["|".join(f"{v:.5f}" for v in (1e3 * motion.time[i], *(1e2 * base[i]), turn[i, 3], *turn[i, :3],
                                             *(1e2 * tip[i]), 1e-5 * motion.inputs[i, 0])) + "|"
                for i in range(151)]  # fmt: skip
        files.append(lines(folder / f"{name}.txt", [head, units, *rows]))
        tables[name] = wide(motion, np.stack([base, tip], axis=1), ("base", "tip"))
    return Laboratory(files, tables, planar(1.0))


def gratings(folder: Path) -> Laboratory:
    """Text of an interrogator: curvatures [1/m] at 12 gratings, arc lengths in cm; the pressure in the last column."""
    files, tables = [], {}
    across = np.array([-np.sin(arm.PLANE), np.cos(arm.PLANE), 0.0])
    for k, (word, level) in enumerate(LEVELS.items()):
        motion, name = pulse(level), f"fbg_{word}"
        turns = arm.Rotation.from_quat(motion.rotation.reshape(-1, 4)).as_rotvec().reshape(151, 13, 3) @ across
        kappa = np.diff(turns, axis=1) / (LENGTH / arm.RODS)
        kappa = np.hstack([kappa[:, :1], kappa, kappa[:, -1:]])  # gratings at both ends of the body, too
        kappa += 0.02 * np.random.default_rng(k).standard_normal(kappa.shape)
        arc = [0.0, *((np.arange(12) + 0.5) * 20 / 12).tolist(), 20.0]
        head = ["Sensing interrogator SI-155", "Channel 1, 14 gratings", "",
                "\t".join(["Time [s]", *(f"K @ {s:.2f} cm" for s in arc), "Pressure [bar]"])]  # fmt: skip
        rows = ["\t".join([f"{t:.3f}", *(f"{v:.4f}" for v in row), f"{1e-5 * p:.5f}"])
                for t, row, p in zip(motion.time, kappa, motion.inputs[:, 0], strict=True)]  # fmt: skip
        files.append(lines(folder / f"{name}.txt", [*head, *rows]))
        tables[name] = (["t", "p_Pa", *(f"k_{10 * s:.3f}" for s in arc)],
                        np.column_stack([motion.time, motion.inputs[:, 0], kappa]))  # fmt: skip
    study = {"actuator": {k: v for k, v in BODY.items() if k != "links"} | {"gravity": [0.0, 9.81, 0.0]},
             "alignment": {}, "mapping": {"curvature_unit": "1/m"},
             "parameters": ["stiffness", "damping", "torque_1", "torque_2"]}  # fmt: skip
    return Laboratory(files, tables, study)
