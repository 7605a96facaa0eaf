"""Files as other laboratories write them: bag, LabVIEW log, tables, text of an interrogator; each ends in a model."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from small_study import DAMPING, LEVELS_KPA, STIFFNESS, TORQUE, changed, table, write_recording, write_study

from pliant.errors import InputError
from pliant.study import load_study, run_study
from pliant.study.draft import draft_study

PSI = 6894.757293168361
AMBIENT = 101_325.0
POINTS = ["t", *(f"{a}_{s}" for s in ("base", "tip") for a in "xyz")]


def bag(folder: Path, name: str, columns: np.ndarray) -> str:
    """Poses of two rigid bodies and an absolute pressure, by rosbags; the tip is stamped 1 ms after the base."""
    rosbags = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    made = store.types

    def header(t: float):
        ns = 1_700_000_000 * 10**9 + round(1e9 * t)
        stamp = made["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        return made["std_msgs/msg/Header"](stamp=stamp, frame_id="mocap")

    with rosbags.Writer(folder / name, version=9, storage_plugin=rosbags.StoragePlugin.MCAP) as writer:
        kinds = {"/vicon/base": "geometry_msgs/msg/PoseStamped", "/vicon/tip": "geometry_msgs/msg/PoseStamped",
                 "/regulator": "sensor_msgs/msg/FluidPressure", "/camera/count": "std_msgs/msg/Float64"}  # fmt: skip
        topics = {t: writer.add_connection(t, kind, typestore=store) for t, kind in kinds.items()}
        for t, kpa, *places in columns.tolist():
            for topic, late, xyz in (("/vicon/base", 0.0, places[:3]), ("/vicon/tip", 1e-3, places[3:])):
                pose = made["geometry_msgs/msg/Pose"](
                    position=made["geometry_msgs/msg/Point"](*xyz),
                    orientation=made["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
                )
                message = made[kinds[topic]](header=header(t + late), pose=pose)
                writer.write(topics[topic], round(1e9 * t), store.serialize_cdr(message, kinds[topic]))
            fluid = made[kinds["/regulator"]](header=header(t), fluid_pressure=1e3 * kpa + AMBIENT, variance=0.0)
            writer.write(topics["/regulator"], round(1e9 * t), store.serialize_cdr(fluid, kinds["/regulator"]))
            count = made[kinds["/camera/count"]](data=t)
            writer.write(topics["/camera/count"], round(1e9 * t), store.serialize_cdr(count, kinds["/camera/count"]))
    return f"{name}/{next((folder / name).glob('*.mcap')).name}"


def lvm(path: Path, columns: np.ndarray, unit: str = "psi") -> str:
    """LabVIEW's text: a header with a line that nobody knows, a second channel, a remark beside one row."""
    head = ["LabVIEW Measurement\t", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab", "X_Columns\tOne",
            "our rig, left bench", "***End_of_Header***", "", "Channels\t2",
            f"Y_Unit_Label\t{unit}\tDeg C", "X0\t0.0\t0.0", "Delta_X\t0.01\t0.01", "***End_of_Header***",
            "X_Value\tPressure\tRoom\tComment"]  # fmt: skip
    rows = [f"{t:.6f}\t{1e3 * kpa / PSI:.7f}\t21.{k % 10}" + ("\tvalve opened" if k == 20 else "")
            for k, (t, kpa) in enumerate(columns[:, :2].tolist())]  # fmt: skip
    path.write_text("\r\n".join([*head, *rows, ""]), encoding="latin-1")
    return path.name


def judged(folder: Path, recordings: dict) -> None:
    """Run the small study on these recordings: it must find the body that made them and predict the middle pressure."""
    study = load_study(write_study(folder, changed("recordings", value=recordings), recordings=False))
    fit = run_study(study).fits[0]
    values = fit.result.values
    assert values["stiffness"] * TORQUE / STIFFNESS == pytest.approx(values["torque_1"], rel=5e-3)  # what statics show
    assert values["stiffness"] == pytest.approx(STIFFNESS, rel=0.02)
    assert values["damping"] == pytest.approx(DAMPING, rel=0.05)
    held = next(r for r in fit.records if r.role == "held_out")
    assert (held.name, held.metrics["rmse_percent_of_travel"] < 1.0) == ("middle", True)


@pytest.mark.slow
def test_a_ros_bag_of_rigid_bodies_and_an_absolute_pressure_ends_in_a_model(tmp_path):
    mapping = {"topics": {"base": "/vicon/base", "tip": "/vicon/tip"},
               "linear": {"pressure": {"offset": -AMBIENT, "unit": "Pa"}}}  # fmt: skip
    files = {name: bag(tmp_path, name, table(level)) for name, level in LEVELS_KPA.items()}
    judged(tmp_path, {name: {"file": file, "mapping": mapping} for name, file in files.items()})


def test_a_trackers_table_beside_a_labview_log_ends_in_a_model(tmp_path):
    for name, level in LEVELS_KPA.items():
        write_recording(tmp_path / f"{name}.csv", np.delete(table(level), 1, axis=1), POINTS)
        lvm(tmp_path / f"{name}_log.lvm", table(level))
    judged(tmp_path, {name: {"file": f"{name}.csv", "pressure_file": f"{name}_log.lvm", "clock": "same"}
                      for name in LEVELS_KPA})  # fmt: skip


@pytest.mark.slow
def test_a_bag_with_absolute_pressures_is_named_before_it_becomes_a_model(tmp_path):
    file = bag(tmp_path, "high", table(120.0))
    draft = draft_study([tmp_path / file], tmp_path / "high.toml", length=0.12, mass=0.05)
    assert "atmosphere" in draft.text


def test_a_labview_log_in_an_unknown_unit_ends_in_a_sentence_with_the_remedy(tmp_path):
    lvm(tmp_path / "high_log.lvm", table(120.0), unit="V")
    write_recording(tmp_path / "high.csv", np.delete(table(120.0), 1, axis=1), POINTS)
    pair = {"file": "high.csv", "pressure_file": "high_log.lvm", "clock": "same"}
    content = changed("recordings", value=dict.fromkeys(LEVELS_KPA, pair))
    study = load_study(write_study(tmp_path, content, recordings=False))
    with pytest.raises(InputError, match="no channel with a unit of pressure: name"):
        run_study(study)


ARC = range(0, 151, 10)  # mm
GRATINGS = {"format": "curvature", "skip_lines": 4, "curvature": "Curvature ", "direction": "Angle ",
            "curvature_unit": "1/m"}  # fmt: skip


def ringing(level: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, curvatures (T, 16) with noise and pressure of a body whose even curvature rings at 4 Hz.

    No chain of links, and no pliant, made it.
    """
    rng, t, fine = np.random.default_rng(seed), np.arange(0.0, 3.0, 0.02), np.arange(0.0, 3.0, 1e-3)
    pressure = level * (1.0 / (1.0 + np.exp((0.5 - fine) / 0.02)) - 1.0 / (1.0 + np.exp((1.8 - fine) / 0.02)))  # kPa
    w, kappa, rate, curvatures = 2 * np.pi * 4.0, 0.0, 0.0, []
    for p in pressure.tolist():
        curvatures.append(kappa)
        rate += 1e-3 * (w * w * (0.08 * p - kappa) - 2 * 0.08 * w * rate)
        kappa += 1e-3 * rate
    noise = 0.02 * rng.standard_normal((t.size, len(ARC)))
    return t, np.interp(t, fine, curvatures)[:, None] + noise, np.interp(t, fine, pressure)  # s, 1/m, kPa


def interrogator(path: Path, level: float, seed: int) -> Path:
    """Text of 16 gratings along the body of `ringing`."""
    t, seen, pressure = ringing(level, seed)
    names = ["Time (s)", *(f"Curvature {s} mm (1/m)" for s in ARC), *(f"Angle {s} mm (deg)" for s in ARC), "Line (kPa)"]
    rows = np.column_stack([t, seen, np.full(seen.shape, 90.0), pressure])
    head = "Interrogator: 16 gratings\nDate: 2026-01-12\nFibre length (mm): 150\n\n" + "\t".join(names)
    np.savetxt(path, rows, fmt="%.4f", delimiter="\t", header=head, comments="")
    return path


def luna(folder: Path, level: float, seed: int) -> list[Path]:
    """Strain of four cores along the body of `ringing`, a table each, and a log of the pressure.

    A centre core and three at 70 um, the first 20 degrees from the direction of bending. A common strain drifts.
    """
    t, seen, pressure = ringing(level, seed)
    day = [f"2026-01-12 09:{int(x // 60):02d}:{x % 60:09.6f}" for x in t.tolist()]
    head = ["Test name:\tfinger", "Date:\t2026-01-12", "Gage Pitch (mm):\t10.0", "Units:\tmicrostrain", "-" * 40,
            "x-axis\t\t\t" + "\t".join(f"{1e-3 * s:.4f}" for s in ARC)]  # fmt: skip
    for core in range(4):
        turn = np.radians(20.0) + 2 * np.pi * (core - 1) / 3
        strain = -70.0 * (core > 0) * np.cos(turn) * seen + 5.0 * t[:, None]  # um/m of the fibre's axis
        rows = [f"{d}\tmeasurement\tstrain\t" + "\t".join(f"{x:.2f}" for x in row)
                for d, row in zip(day, strain.tolist(), strict=True)]  # fmt: skip
        (folder / f"pulse_{level}kPa_core{core}.tsv").write_text("\n".join([*head, *rows, ""]), encoding="utf-8")
    log = folder / f"pulse_{level}kPa_core0_log.csv"
    np.savetxt(log, np.column_stack([t, pressure]), fmt="%.5f", delimiter=",", header="t_s,p_kpa", comments="")
    return [folder / f"pulse_{level}kPa_core0.tsv", log]


CORES = {"cores": {"radius_um": 70, "first_angle_deg": 20.0, "files": ["core0", "core1", "core2", "core3"]}}


@pytest.mark.slow  # a dense shape, reduced and fitted
def test_strain_of_the_cores_of_a_fibre_ends_in_a_model(tmp_path):
    files = [file for level in (30, 50, 70) for file in luna(tmp_path, level, level)]
    draft = draft_study(files, tmp_path / "fibre.toml", mapping=CORES, mass=0.06)
    assert draft.questions == ()
    (tmp_path / "fibre.toml").write_text(draft.text, encoding="utf-8")
    held = run_study(load_study(tmp_path / "fibre.toml")).fits[0].records[-1]
    assert (held.name, held.role) == ("pulse_50kPa_core0", "held_out")
    assert held.metrics["rmse_percent_of_travel"] < 4.0
    assert held.metrics["frequency_hz"]["modelled"] == pytest.approx(4.0, rel=0.03)


@pytest.mark.parametrize(("mapping", "message"), [
    (None, r"strain of a fibre: (describe|state) its cores .*\[cores\]\) and give that by --mapping"),
    ({"cores": {}}, "radius_um: Field required"),
    ({"cores": 35}, "must be a table"),
    ({"cores": {"radius_um": 70}}, "of 1 core.*describes 4: name the files of the others in cores.files"),
    ({"cores": {"radius_um": 70, "files": ["core7", "core0"]}}, "'core7', must occur once"),
    ({"cores": {"radius_um": 70, "files": ["core0", "core9"]}}, "core9.tsv: there is no such file"),
    ({"cores": {"radius_um": 70, "centre": False, "files": ["core0", "core1"]}}, "of 2 core.*describes 3"),
])  # fmt: skip
def test_strain_that_gives_no_shape_ends_in_a_sentence_with_the_remedy(tmp_path, mapping, message):
    files = luna(tmp_path, 30, 30)
    with pytest.raises(InputError, match=message):
        draft_study(files, tmp_path / "fibre.toml", mapping=mapping, mass=0.06)


@pytest.mark.slow  # a dense shape, reduced and fitted
def test_an_interrogators_text_of_curvatures_ends_in_a_model(tmp_path):
    files = [interrogator(tmp_path / f"fbg_{level}kPa.txt", level, level) for level in (30, 50, 70)]
    draft = draft_study(files, tmp_path / "fbg.toml", mapping=GRATINGS, mass=0.06)
    assert draft.questions == ()
    (tmp_path / "fbg.toml").write_text(draft.text, encoding="utf-8")
    held = run_study(load_study(tmp_path / "fbg.toml")).fits[0].records[-1]
    assert (held.name, held.role) == ("fbg_50kPa", "held_out")
    assert held.metrics["rmse_percent_of_travel"] < 4.0
    assert held.metrics["frequency_hz"]["modelled"] == pytest.approx(4.0, rel=0.03)
