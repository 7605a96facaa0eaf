"""A run that is stopped leaves a sentence, and no model without its metrics."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from small_study import STUDY, write_study

from pliant.study import load_study, run_study


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals of another kind")
def test_ctrl_c_ends_a_run_with_its_sentence(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "pliant", "run", str(write_study(tmp_path, STUDY)), "-o", str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as running:
        assert running.stderr is not None
        assert "prepared" in running.stderr.readline()
        running.send_signal(signal.SIGINT)
        said = running.communicate(timeout=60)[1]
    assert running.returncode == 130
    assert said.endswith("pliant: interrupted; nothing half written was left behind\n")
    assert "Traceback" not in said
    assert not (tmp_path / "out" / "model.json").exists()


def test_a_run_stopped_while_it_writes_leaves_no_model_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = load_study(write_study(tmp_path, STUDY))

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pliant.view.report.write_report", stop)
    with pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path / "out")
    left = {path.name for path in (tmp_path / "out").iterdir()}
    assert not left & {"model.json", "metrics.json"}
    assert not any(name.endswith(".tmp") for name in left)
