"""What a task file may not mix."""

from __future__ import annotations

import pytest

from pliant.control import read_task
from pliant.errors import InputError

X, Y = "[[setpoint]]\ntime_s = 0\ntip_x_mm = -20\n", "[[setpoint]]\ntime_s = 1\ntip_y_mm = 3\n"
BENT = "[[setpoint]]\ntime_s = 1\ndisplacement_mm = 10\n"


@pytest.mark.parametrize("points", [X + Y, Y + X, X + BENT, X + X + X + Y])
def test_set_points_of_two_kinds_are_refused(tmp_path, points):
    (tmp_path / "task.toml").write_text(points)
    with pytest.raises(InputError, match="setpoint"):
        read_task(tmp_path / "task.toml")


def test_set_points_of_one_kind_are_taken(tmp_path):
    (tmp_path / "task.toml").write_text(X + X.replace("= 0", "= 1"))
    assert read_task(tmp_path / "task.toml").task.outputs == ("tip_x",)
