"""Recordings of one known body in the habits of different laboratories; every number is made here, by code.

`small_study.table` gives the truth: times, pressure [kPa], base and tip [m] in a tracker's axes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from small_study import AXES, LEVELS_KPA, ORIGIN, TIMES, body, table

from pliant.simulation import Trace, simulate

LENGTH, MASS = 0.12, 0.05
TANGENT = AXES[:, 1]
HANGING = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # columns: x, y and z of a base whose z is -y
PSI = 6.894757293168361  # kPa
EPOCH = 1_760_000_000  # s since 1970
LEVELS = [*LEVELS_KPA.values()]


def turned(level: float) -> np.ndarray:
    """Quaternions (T, 4) of the tip: it turns about the z axis of the base by twice the angle of its chord."""
    along = (table(level)[:, 5:8] - ORIGIN) @ AXES
    angle = 2.0 * np.arctan2(-along[:, 0], along[:, 1])
    return (Rotation.from_matrix(AXES) * Rotation.from_rotvec(np.outer(angle, [0.0, 0.0, 1.0]))).as_quat()


def lines(path: Path, rows: list[str]) -> Path:
    path.write_text("\n".join([*rows, ""]), encoding="utf-8")
    return path


def vrpn(folder: Path) -> list[Path]:
    """One body, stamped in seconds and microseconds; zeros where it was lost; psi on the clock of a logger."""
    files = []
    for level in LEVELS:
        t, kpa, tip, quaternion = TIMES, table(level)[:, 1], table(level)[:, 5:8], turned(level)
        rows = ["sec,usec,x,y,z,qx,qy,qz,qw"]
        for k, time in enumerate(t):
            micro = round(1e6 * (time + 0.25))
            pose = [*tip[k], *quaternion[k]] if k not in (40, 41, 90) else [0.0] * 7
            rows.append(f"{EPOCH + micro // 10**6},{micro % 10**6}," + ",".join(f"{v:.6f}" for v in pose))
        files.append(lines(folder / f"arm_{level:.0f}.csv", rows))
        log = [f"{round(1e3 * time) + 5210};{p / PSI:.3f}" for time, p in zip(t, kpa, strict=True)]
        files.append(lines(folder / f"arm_{level:.0f}_log.txt", ["millis;psi", *log]))
    return files


def motive(folder: Path) -> list[Path]:
    """Motive: a rigid body at the base, three markers at the tip, unlabelled ones; counts of a converter in TDMS."""
    from nptdms import ChannelObject, TdmsWriter

    files = []
    plate = np.array([[15.0, 0, 0], [-8, 0, 13], [-8, 0, -13]])
    for level in LEVELS:
        data = table(level)
        base, tip, turn = 1e3 * data[:, 2:5], 1e3 * data[:, 5:8], Rotation.from_quat(turned(level))
        markers = tip[:, None] + np.stack([turn.apply(p) for p in plate], axis=1)
        n = len(TIMES)
        columns = [("Rigid Body", "base", 7), *(("Marker", f"tip:Marker{k}", 3) for k in (1, 2, 3)),
                   *(("Marker", f"Unlabeled {k}", 3) for k in (1001, 1002))]  # fmt: skip
        stray = np.full((n, 6), np.nan)
        stray[60:75] = 410.0
        q = np.tile(Rotation.from_matrix(AXES).as_quat(), (n, 1))
        values = np.column_stack([q, base, markers.reshape(n, 9), stray])
        each = [cell for kind, _, width in columns for cell in [kind] * width]
        names = [cell for _, name, width in columns for cell in [name] * width]
        roles = ["Rotation"] * 4 + ["Position"] * 18
        first = ("Format Version,1.23,Take Name,take,Capture Frame Rate,100.000000,Export Frame Rate,100.000000,"
                 f"Total Frames in Take,{n},Total Exported Frames,{n},Rotation Type,Quaternion,Length Units,"
                 "Millimeters,Coordinate Space,Global")  # fmt: skip
        head = [first, "", ",Type," + ",".join(each), ",Name," + ",".join(names),
                ",ID," + ",".join(names), ",," + ",".join(roles),
                "Frame,Time (Seconds)," + ",".join([*"XYZW", *"XYZ" * 6])]  # fmt: skip
        rows = [f"{k},{TIMES[k]:.6f}," + ",".join("" if np.isnan(v) else f"{v:.6f}" for v in row)
                for k, row in enumerate(values)]  # fmt: skip
        files.append(lines(folder / f"take_{level:.0f}.csv", [*head, *rows]))
        counts = np.round(data[:, 1] / 0.05 + 512.0)
        channel = ChannelObject("daq", "ai0", counts, properties={"wf_start_offset": 0.0, "wf_increment": 0.01})
        files.append(folder / f"take_{level:.0f}.tdms")
        with TdmsWriter(files[-1]) as writer:
            writer.write_segment([channel])
    return files


def matlab(folder: Path) -> list[Path]:
    """One MATLAB file with a cell of trials, each a struct of times, positions [mm] and pressure [bar]."""
    from scipy.io import savemat

    trials = np.empty(len(LEVELS), object)
    for k, level in enumerate(LEVELS):
        data = table(level)[: len(TIMES) - 5 * k]
        trials[k] = {"t": data[:, 0], "xyz": 1e3 * data[:, 2:].reshape(len(data), 2, 3), "p": data[:, 1] / 100.0,
                     "operator": "A"}  # fmt: skip
    savemat(folder / "arm.mat", {"train": trials})
    return [folder / "arm.mat"]


def bag(folder: Path) -> list[Path]:
    """Folders of ROS 2 bags with an inertial sensor at the tip and an absolute pressure."""
    import rosbags.rosbag2 as rosbags
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    types, files = store.types, []
    for level in LEVELS:
        data, noise = table(level), np.random.default_rng(int(level))
        along = (data[:, 5:8] - ORIGIN) @ AXES
        angle = 2.0 * np.arctan2(-along[:, 0], along[:, 1])
        gravity = 9.81 * np.column_stack([np.sin(angle), np.cos(angle), 0.02 + 0 * angle])
        gravity += 0.01 * noise.standard_normal(gravity.shape)
        path = folder / f"arm_{level:.0f}"
        with rosbags.Writer(path, version=9, storage_plugin=rosbags.StoragePlugin.MCAP) as writer:
            imu, fluid = (writer.add_connection(topic, kind, typestore=store) for topic, kind in (
                ("/tip/imu", "sensor_msgs/msg/Imu"), ("/valve/pressure", "sensor_msgs/msg/FluidPressure")))  # fmt: skip
            for k, time in enumerate(TIMES):
                ns = EPOCH * 10**9 + round(1e9 * time)
                header = types["std_msgs/msg/Header"](
                    stamp=types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9), frame_id="imu")
                vector, nine = types["geometry_msgs/msg/Vector3"], np.zeros(9)
                message = types[imu.msgtype](
                    header=header, orientation=types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
                    orientation_covariance=np.array([-1.0, *nine[1:]]), angular_velocity=vector(0.0, 0.0, 0.0),
                    angular_velocity_covariance=nine, linear_acceleration=vector(*gravity[k]),
                    linear_acceleration_covariance=nine,
                )  # fmt: skip
                writer.write(imu, ns, store.serialize_cdr(message, imu.msgtype))
                air = types[fluid.msgtype](header=header, fluid_pressure=1e3 * data[k, 1] + 101_325.0, variance=0.0)
                writer.write(fluid, ns, store.serialize_cdr(air, fluid.msgtype))
        files.append(path)
    return files


def coils(folder: Path) -> list[Path]:
    """Electromagnetic coils with words for their status and times of day; counts of the encoder of a syringe."""
    files = []
    for level in LEVELS:
        data, quaternion = table(level), turned(level)
        rows = ["Frame,Time,Tip State,Q0,Qx,Qy,Qz,Tx,Ty,Tz,Base State,Bx,By,Bz,Encoder"]
        for k, row in enumerate(data):
            x, y, z, w = quaternion[k]
            lost = 50 <= k < 54
            tip = ["MISSING"] * 7 if lost else [f"{v:.5f}" for v in (w, x, y, z, *(1e3 * row[5:8]))]
            base = [f"{v:.4f}" for v in 1e3 * row[2:5]]
            rows.append(",".join([str(k), clock(row[0]), "MISSING" if lost else "OK", *tip, "OK", *base,
                                  str(round(row[1] / 0.01) + 2048)]))  # fmt: skip
        files.append(lines(folder / f"coil_{level:.0f}.csv", rows))
    return files


def clock(time: float) -> str:
    """A time of day that passes an hour within the recording."""
    total = 13 * 3600 + 59 * 60 + 59.2 + time
    return f"{int(total // 3600):02d}:{int(total // 60) % 60:02d}:{total % 60:09.6f}"


def bars(folder: Path) -> list[Path]:
    """A table with bars between and behind its cells; the quaternion of the base jumps by half a turn of its plate."""
    files = []
    for level in LEVELS:
        data, quaternion = table(level), turned(level)
        base = np.tile(Rotation.from_matrix(AXES).as_quat(), (len(data), 1))
        base[70:100] = (Rotation.from_matrix(AXES) * Rotation.from_rotvec([0.0, np.pi, 0.0])).as_quat()
        names = ["time_ms", *(f"{s}_{a}_mm" for s in ("base", "tip") for a in "xyz"),
                 *(f"{s}_q{a}" for s in ("base", "tip") for a in "xyzw"), "P [mbar]", "note"]  # fmt: skip
        rows = ["|".join(names) + "|"]
        for k, row in enumerate(data):
            cells = [f"{1e3 * row[0]:.1f}", *(f"{v:.4f}" for v in 1e3 * row[2:8]),
                     *(f"{v:.6f}" for v in (*base[k], *quaternion[k])), f"{10 * row[1]:.2f}", "ok"]  # fmt: skip
            rows.append("|".join(cells) + "|")
        files.append(lines(folder / f"bench_{level:.0f}.csv", rows))
    return files


def film(folder: Path) -> list[Path]:
    """Points that a program followed in a film, in pixels with y downwards, and a table of typed steps."""
    files, frames = [], np.arange(0.0, 4.0, 0.02)
    for level in LEVELS:
        begins, typed = np.array([0.5, 1.4, 2.0, 3.1]), level * np.array([1.0, 0.4, 0.8, 0.0])
        times = np.column_stack([begins, begins + 0.01]).ravel()
        trace = Trace(times, 1e3 * np.repeat(np.concatenate([[0.0], typed]), 2)[1:-1])
        tip = simulate(body(), trace, times=frames, time_step=5e-4)["station_position"].values[:, 0]
        noise = 0.1 * np.random.default_rng(int(level)).standard_normal((len(frames), 4))
        places = np.column_stack([np.zeros((len(frames), 2)), 1e3 * tip])
        pixels = np.round(np.array([640.0, 900.0] * 2) + np.array([4.0, -4.0] * 2) * places + noise, 2)
        rows = [f"{t:.3f}," + ",".join(map(str, p)) for t, p in zip(frames, pixels.tolist(), strict=True)]
        files.append(lines(folder / f"film_{level:.0f}.csv", ["t,x_base,y_base,x_tip,y_tip", *rows]))
        steps = [f"{t:.3f};{p:.0f}" for t, p in zip([0.0, *begins], [0.0, *typed], strict=True)]
        files.append(lines(folder / f"steps_{level:.0f}.csv", ["t_s;p_kpa", *steps]))
    return files


def gratings(folder: Path) -> list[Path]:
    """Text of an interrogator: curvatures [1/cm] of 13 gratings along a body of even curvature, times and a pressure.

    The curvature rings at 4 Hz; no chain of links made it.
    """
    files = []
    for level in (30, 50, 70):
        rng, t, fine = np.random.default_rng(level), np.arange(0.0, 3.0, 0.02), np.arange(0.0, 3.0, 1e-3)
        pressure = level * (1.0 / (1.0 + np.exp((0.5 - fine) / 0.02)) - 1.0 / (1.0 + np.exp((1.8 - fine) / 0.02)))
        w, kappa, rate, curvature = 2 * np.pi * 4.0, 0.0, 0.0, []
        for p in pressure.tolist():
            curvature.append(kappa)
            rate += 1e-3 * (w * w * (0.08 * p - kappa) - 2 * 0.08 * w * rate)
            kappa += 1e-3 * rate
        seen = np.interp(t, fine, curvature)[:, None] + 0.02 * rng.standard_normal((t.size, 13))
        names = ["Time (s)", *(f"Curvature {s} mm" for s in range(0, 121, 10)), "Line (kPa)"]
        rows = ["\t".join([f"{time:.2f}", *(f"{0.01 * k:.6f}" for k in row), f"{p:.3f}"])
                for time, row, p in zip(t, seen, np.interp(t, fine, pressure), strict=True)]  # fmt: skip
        head = ["Interrogator: 13 gratings", "Fibre length (mm): 120", "\t".join(names)]
        files.append(lines(folder / f"fbg_{level}kPa.txt", [*head, *rows]))
    return files


def poses(folder: Path) -> list[Path]:
    """A file a settled pose: five markers in any order, one of them on the base; its name says motor and torque.

    The body has even curvature, in proportion to the tension of one tendon; no chain of links made it.
    """
    rng, files, s = np.random.default_rng(8), [], LENGTH * np.array([0.0, 0.3, 0.55, 0.8, 1.0])
    for motor, azimuth in (("m1", 25.0), ("m2", 150.0)):
        for level in (1, 2, 3, 4):
            curve, side = 2.5 * level, np.radians(azimuth)
            out = (1.0 - np.cos(curve * s)) / curve
            points = np.column_stack([np.cos(side) * out, np.sin(side) * out, np.sin(curve * s) / curve])
            order = rng.permutation(len(s))
            seen = ORIGIN + (points[order] + 5e-5 * rng.standard_normal((90, len(s), 3))) @ HANGING.T
            rows = [f"{k},{k / 240.0:.6f}," + ",".join(f"{v:.6f}" for v in row.ravel()) for k, row in enumerate(seen)]
            files.append(lines(folder / f"{motor}_u{level}.csv", rows))
    return files


def sessions(folder: Path) -> list[Path]:
    """Three files of settled poses without header and time: steps of three motors, tip [mm]."""
    rng, files = np.random.default_rng(5), []
    for session in (1, 2, 3):
        steps = rng.integers(-400, 400, (60, 3))
        pulled = steps * 2.0 * np.pi / 3200.0 * 0.01  # m, by drums of 10 mm
        towards = np.radians([90.0, 210.0, 330.0])
        bend = np.column_stack([pulled @ np.cos(towards), pulled @ np.sin(towards)]) * (2.0 / 3.0) / 0.006  # rad
        total = np.linalg.norm(bend, axis=1) + 1e-12
        flat = LENGTH * (1.0 - np.cos(total)) / total
        tip = np.column_stack([bend * (flat / total)[:, None], LENGTH * np.sin(total) / total]) * 1e3
        tip += 0.1 * rng.standard_normal(tip.shape) + [120.0, -40.0, 305.0]
        files.append(lines(folder / f"session{session}.txt",
                           ["\t".join([*map(str, s), *(f"{v:.2f}" for v in p)])
                            for s, p in zip(steps, tip, strict=True)]))  # fmt: skip
    return files
