"""Films are decoded in a helper process, and a film of which frames are lost is refused or told."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from command_line import invoke

from pliant.errors import InputError
from pliant.video.reel import Film, open_reel
from pliant.video.track import Tracking, judge_film, stated_bytes

SIZE = (96, 64)


def film(path, frames=24, codec="MJPG"):
    """A film of noise, whose frame number is the level of its corner."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), 25.0, SIZE)
    rng = np.random.default_rng(0)
    for k in range(frames):
        picture = rng.integers(0, 255, (SIZE[1], SIZE[0], 3)).astype(np.uint8)
        picture[:32, :32] = 6 * k
        writer.write(picture)
    writer.release()
    return path


def test_frames_come_from_a_helper_that_serves_several_requests(tmp_path, monkeypatch):
    source = Film(film(tmp_path / "a.avi"))

    def refuse(*_):
        raise AssertionError("a film was opened in this process")

    monkeypatch.setattr(cv2, "VideoCapture", refuse)
    assert source.facts() == {"height": 64, "width": 96, "rate": 25.0, "count": 24}
    helper = source._idle[0]
    levels = [picture[:16, :16].mean() for _, picture in source.frames()]
    assert levels == pytest.approx(6 * np.arange(24), abs=4)
    assert source._idle == [helper]
    times, few = zip(*source.frames([3, 20]), strict=True)
    assert times == pytest.approx([3 / 25, 20 / 25])
    assert [p[:16, :16].mean() for p in few] == pytest.approx([18, 120], abs=4)
    few[0][:] = 0  # a picture can be changed
    next(source.frames())  # left early: its helper is ended, not reused
    assert source._idle == []
    assert len(list(source.frames([1]))) == 1


def test_a_helper_that_dies_is_an_error_in_one_sentence(tmp_path):
    source = Film(film(tmp_path / "a.avi"))
    frames = source.frames()
    next(frames)
    process = next(v for v in frames.gi_frame.f_locals.values() if hasattr(v, "process")).process
    process.kill()
    with pytest.raises(InputError, match=r"a[.]avi cannot be decoded: its decoder crashed"):
        list(frames)
    (tmp_path / "no.avi").write_bytes(b"RIFF" + bytes(5000))
    with pytest.raises(InputError, match=r"OpenCV cannot read no[.]avi as a video, as it has no frame"):
        open_reel(tmp_path / "no.avi")


@pytest.mark.parametrize(("name", "codec"), [("a.avi", "MJPG"), ("a.mp4", "mp4v")])
def test_the_length_that_a_container_states_is_that_of_its_file(tmp_path, name, codec):
    path = film(tmp_path / name, codec=codec)
    whole = path.read_bytes()
    assert stated_bytes(path) == len(whole)
    assert judge_film(path, 24, 24, incomplete=False) == []
    path.write_bytes(whole[: len(whole) // 2])
    assert stated_bytes(path) > len(whole) // 2
    other = tmp_path / "a.webm"
    other.write_bytes(b"\x1aE\xdf\xa3" + bytes(100))
    assert stated_bytes(other) == 0


def test_a_truncated_film_is_refused_by_the_program_and_writes_nothing(tmp_path):
    path = film(tmp_path / "a.avi", 40)
    content = path.read_bytes()
    path.write_bytes(content[: int(0.6 * len(content))])
    camera = tmp_path / "cam.toml"
    camera.write_text("[camera]\npixels_per_mm = 1.0\n")
    marks = ("--method", "dots", "--colour", "#ffffff")
    ended = invoke("track", path, "-o", tmp_path / "a.nc", "--camera", camera, *marks)
    assert ended.exit_code != 0
    assert not (tmp_path / "a.nc").exists()
    read = len(list(Film(path).frames()))
    assert 0 < read < 40
    with pytest.raises(InputError, match=rf"states 40 frames .*only {read} of 40 .* incomplete = true in \[tracking\]"):
        judge_film(path, 40, read, incomplete=False)
    accepted = judge_film(path, 40, read, incomplete=True)
    assert len(accepted) == 2
    assert f"only {read} of 40 were read" in accepted[0]
    with pytest.raises(InputError, match="incomplete must be true or false"):
        Tracking(incomplete="yes")


def test_a_few_frames_that_a_whole_mp4_lists_and_does_not_show_are_told(tmp_path):
    path = film(tmp_path / "a.mp4", codec="mp4v")
    assert judge_film(path, 24, 22, incomplete=False) == [
        "WARNING: a.mp4 states 24 frames, but 22 of 24 were decoded"
    ]
    with pytest.raises(InputError, match="only 12 of 24"):
        judge_film(path, 24, 12, incomplete=False)
