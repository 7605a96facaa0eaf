"""Pressures of LabVIEW's files, text and binary, made here as LabVIEW writes them."""

from __future__ import annotations

import numpy as np
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from pliant.errors import InputError
from pliant.preprocessing.quality import quality
from pliant.recording import read, write
from pliant.study.first_reading import with_logs

T = np.arange(200) / 100
P = 10 * (T > 0.5)  # psi
PSI = 6894.757293168361


def lvm(path, *, layout="One", separator="\t", decimal=".", unit="psi"):
    """A file with a junk line in its header and a comment beside one row."""
    def line(*cells):
        return separator.join(cells)

    head = ["LabVIEW Measurement\t", line("Writer_Version", "2"),
            line("Separator", "Tab" if separator == "\t" else "Comma"),
            line("Decimal_Separator", decimal), line("X_Columns", layout), "something that nobody knows",
            "***End_of_Header***", "", line("Channels", "2"), line("Y_Unit_Label", unit, "Deg C"),
            line("X0", "0.0", "0.0"), line("Delta_X", "0.01", "0.01"), "***End_of_Header***"]  # fmt: skip
    multi = ["X_Value"] if layout == "Multi" else []
    rows = [line("X_Value", "Chamber", *multi, "Temp", "Comment")]
    for k, (t, p) in enumerate(zip(T, P, strict=True)):
        x = "" if layout == "No" else f"{t:.6f}"
        cells = [c.replace(".", decimal) for c in (x, f"{p:.6f}", *[x for _ in multi], "21.5")]
        rows.append(line(*cells, *(["valve opened"] if k == 50 else [])))
    path.write_text("\n".join([*head, *rows, ""]), encoding="utf-8")
    return path


@pytest.mark.parametrize("options", [
    {}, {"layout": "No"}, {"layout": "Multi"}, {"separator": ","}, {"decimal": ","},
])
def test_lvm_of_every_layout(tmp_path, options):
    ds = read(lvm(tmp_path / "log.lvm", **options))
    np.testing.assert_allclose(ds["pressure_time"], T, atol=1e-12)
    np.testing.assert_allclose(ds["pressure"], P * PSI, rtol=1e-12)
    assert "1 rows of log.lvm have a comment" in ds.attrs["history"]
    assert "left out: Temp" in ds.attrs["history"]


def test_channels_that_name_coordinates_are_positions(tmp_path):
    path, place = tmp_path / "run.tdms", {"base": (0.0, 0.0, 5.0), "tip": (20.0, 30.0, 100.0)}

    def channel(name, values, unit):
        return ChannelObject("Log", name, values, properties={"wf_increment": 0.01, "unit_string": unit})

    def write_places(unit):
        with TdmsWriter(path) as writer:
            writer.write_segment([channel("Chamber", P * 1.0, "psi"), *(
                channel(f"{s}_{a}", np.full(len(T), v), unit)
                for s, xyz in place.items() for a, v in zip("xyz", xyz, strict=True))])  # fmt: skip

    write_places("mm")
    ds = read(path)
    assert ds["station"].values.tolist() == ["base", "tip"]
    np.testing.assert_allclose(ds["position"].values[7], [[0.0, 0.0, 0.005], [0.02, 0.03, 0.1]])
    np.testing.assert_allclose(ds["pressure"].values, P * PSI)
    np.testing.assert_allclose(ds["time"].values, T, atol=1e-12)
    write_places("V")
    ds = read(path)
    assert "position" not in ds
    np.testing.assert_allclose(ds["pressure"].values, P * PSI)
    assert "6 channel(s) of run.tdms hold no pressure and were left out: base_x" in ds.attrs["history"]


@pytest.mark.parametrize(("others", "reason"), [
    ({"Joystick X": "V", "Joystick Y": "V", "Joystick Z": "V"}, ""),
    ({"Mx": "Nmm", "My": "Nmm", "Mz": "Nmm"}, ""),
    ({"Stage_x": "mm", "Encoder_y": "um"}, "several units of length"),
    ({"tip_x": "mm", "tip_y": "mm", "tip_z": "mm", "base_x": "mm", "base_y": "mm", "base_z": "mm"}, "at one rate"),
])
def test_channels_that_are_no_positions_leave_the_pressures(tmp_path, others, reason):
    path = tmp_path / "run.tdms"

    def channel(name, unit):
        rate = 0.02 if name.startswith("base") else 0.01
        return ChannelObject("Log", name, P * 1.0, properties={"wf_increment": rate, "unit_string": unit})

    with TdmsWriter(path) as writer:
        writer.write_segment([channel("Chamber", "psi"), *(channel(*item) for item in others.items())])
    ds = read(path)
    assert "position" not in ds
    np.testing.assert_allclose(ds["pressure"].values, P * PSI)
    assert f"{len(others)} channel(s) of run.tdms hold no pressure" in ds.attrs["history"]
    assert reason in ds.attrs["history"]


def test_a_channel_without_a_unit_is_named_by_the_mapping(tmp_path):
    path = lvm(tmp_path / "log.lvm", unit="Volts")
    with pytest.raises(InputError, match=r"no channel with a unit of pressure: name .* Chamber \(Volts\)"):
        read(path)
    ds = read(path, mapping={"pressure": ["Chamber"], "pressure_unit": "kPa", "linear": {"pressure": {"scale": 2.0}}})
    assert float(ds["pressure"].max()) == pytest.approx(20e3)
    with pytest.raises(InputError, match="no channel 'Chamer'"):
        read(path, mapping={"pressure": ["Chamer"]})


def test_damaged_lvm_is_refused(tmp_path):
    path = lvm(tmp_path / "log.lvm")
    text = path.read_text()
    for content, said in (
        (text[: text.rindex("***End")], "1 headers, but a LabVIEW measurement has two"),
        (text + text, "3 segments"), (text.replace("\t21.5\n0.500", "\tx\n0.500", 1), "is not a number: 'x'"),
    ):  # fmt: skip
        path.write_text(content)
        with pytest.raises(InputError, match=said):
            read(path)


def tdms(path, *, step=True):
    waveform = {"wf_start_offset": 0.0, "wf_increment": 0.01} if step else {}
    channels = [ChannelObject("valves", "left", P, properties={**waveform, "unit_string": "psi"}),
                ChannelObject("valves", "right", 2 * P, properties={**waveform, "unit_string": "psi"}),
                ChannelObject("room", "note", ["a", "b"])]  # fmt: skip
    with TdmsWriter(path) as writer:
        writer.write_segment(channels if step else [*channels, ChannelObject("valves", "Time", T)])
    return path


@pytest.mark.parametrize("step", [True, False])
def test_tdms_by_waveform_and_by_a_channel_of_time(tmp_path, step):
    ds = read(tdms(tmp_path / "log.tdms", step=step))
    np.testing.assert_allclose(ds["pressure_time"], T, atol=1e-12)
    np.testing.assert_allclose(ds["pressure"], np.stack([P, 2 * P], 1) * PSI, rtol=1e-12)
    assert ds["chamber"].values.tolist() == ["left", "right"]
    assert "hold no numbers: note" in ds.attrs["history"]


@pytest.mark.parametrize("cut", [10, 150, -100])
def test_a_cut_tdms_is_refused(tmp_path, cut):
    path = tdms(tmp_path / "log.tdms")
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(InputError, match="only 0 of 1 were read: the file is truncated"):
        read(path)


@pytest.mark.parametrize("ending", ["lvm", "tdms", "mat"])
def test_a_log_of_any_format_is_laid_beside_its_recording_and_says_what_it_is(tmp_path, recording, ending):
    shape = write(recording, tmp_path / "push.csv")
    log = tmp_path / f"push_log.{ending}"
    if ending == "mat":
        savemat(log, {"t": T, "p_psi": P})
    else:
        {"lvm": lvm, "tdms": tdms}[ending](log)
    assert with_logs([log, shape]) == [(shape, None, log, None, "")]
    first, second, *_ = quality(read(log)).summary().splitlines()
    of = " of 2 chambers" if read(log)["pressure"].ndim == 2 else ""
    assert first == f"log of 200 pressure samples{of}, 1.99 s at 100 Hz"
    assert "no shape" in second
