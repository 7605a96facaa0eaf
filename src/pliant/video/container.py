"""Check whether the file of a film is as long as its container states, and whether all its frames were decoded."""

from __future__ import annotations

from pathlib import Path

from pliant.recording.stated import WARNING, Stated, judge_stated

FEW = 0.1  # of the frames of a container that may list frames which are not shown, such as those before a cut
UNSTATED = 0xFFFFFFFF


def stated_bytes(path: Path) -> int:
    """Return the number of bytes that the chunks of an AVI file, or the boxes of an MP4 or MOV file, state; 0 for other
    containers and for files that do not state it.

    Sources: Microsoft, AVI RIFF File Reference; ISO/IEC 14496-12, 4.2
    """
    size, position = path.stat().st_size, 0
    with path.open("rb") as file:
        head = file.read(12)
        riff = head.startswith(b"RIFF")
        if not riff and head[4:8] not in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"):
            return 0
        while position + 8 <= size:
            file.seek(position)
            head = file.read(16)
            length = int.from_bytes(head[4:8], "little") + 8 if riff else int.from_bytes(head[:4], "big")
            if riff and length - 8 in (0, UNSTATED):  # of a recording that was not closed
                return 0
            if not riff and length == 1:
                length = int.from_bytes(head[8:16], "big")
            if not riff and length < 8:  # the last box takes the rest of the file
                return size
            if riff and head[:4] not in (b"RIFF", b"JUNK", b"idx1"):
                return size
            position += length + (length % 2 if riff else 0)
    return position - (1 if riff and position == size + 1 else 0)


def judge_film(path: Path, stated: int, read: int, *, incomplete: bool) -> list[str]:
    """Return warnings where fewer frames were decoded than a film states, or where its file is shorter than it states.

    Raises
    ------
    InputError
        When the file is truncated or frames are lost, unless `incomplete` accepts that.
    """
    length, size = stated_bytes(path), path.stat().st_size
    lost = stated - read
    with path.open("rb") as file:
        avi = file.read(4) == b"RIFF"
    if lost <= 0 and length <= size:
        return []
    if length <= size and not avi and lost <= max(1, FEW * stated):
        return [f"{WARNING}{path.name} states {stated} frames, but {read} of {stated} were decoded"]
    entries = [Stated("frames", "its index", stated, read, "at least"),
               Stated("bytes", "its container", length, size, "at least")]  # fmt: skip
    return judge_stated(entries, path.name, incomplete=incomplete, place="[tracking]")
