import json

import pytest
import typer
from typer.testing import CliRunner

from pliant.cli.order import order
from pliant.errors import InputError

app = typer.Typer()
app.command()(order)


@pytest.fixture
def file(tmp_path):
    import numpy as np

    from pliant.recording import make_recording, write

    s = np.linspace(0, 0.17, 80)
    kappa = np.linspace(2, 14, 25)[:, None]
    points = np.stack([np.cos(kappa * s) - 1, np.sin(kappa * s)], axis=2) / kappa[..., None]
    return write(make_recording(np.arange(25) / 75, points, arc_length=s, frame="planar"), tmp_path / "body.nc")


def test_json_form(file):
    result = CliRunner().invoke(app, [str(file), "--json", "--max-order", "4", "--bound-mm", "3"])
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert list(data) == ["orders", "chosen", "bound_mm", "frames", "stations"]
    assert list(data["orders"]) == ["2", "3", "4"]
    assert data["bound_mm"] == 3
    assert data["frames"] == 25
    assert data["chosen"] in (2, 3, 4)


def test_table_and_figure(file, tmp_path):
    result = CliRunner().invoke(app, [str(file), "--bound-mm", "3", "--figure", str(tmp_path / "order.png")])
    assert result.exit_code == 0, result.output
    assert "lowest order within the bound of 3 mm" in result.output
    assert "Worst frames" in result.output
    assert (tmp_path / "order.png").stat().st_size > 5000


def test_a_mapping_that_cannot_be_read(file, tmp_path):
    result = CliRunner().invoke(app, [str(file), "--mapping", str(tmp_path / "none.toml")])
    assert isinstance(result.exception, InputError)
    (tmp_path / "bad.toml").write_text("= 3")
    result = CliRunner().invoke(app, [str(file), "--mapping", str(tmp_path / "bad.toml")])
    assert "TOML" in str(result.exception)
