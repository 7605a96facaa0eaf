"""Test pliant with damaged files, malicious models and studies, energy balances of random chains, and an attacked loop.

    python tests/hardness/hardness.py --files 100000 --models 20000 --loop --minutes 300     # the full size
    python tests/hardness/hardness.py --files 2000 --models 500                              # a short run
    python tests/hardness/hardness.py --hdf5 20000                                           # HDF5 alone
    python tests/hardness/hardness.py --prices                                               # the cost of the checks

Formats with a helper process are read in a process forked for each file (`forked.py`), under the limits of
`pliant.recording.apart`. Every attempt runs in a supervised process. If a process ends by a signal or takes longer than
`--patience`, the attempt is counted and named by its seed, and the work continues with the next attempt. `silent`
counts changes that the format could reveal and that were not reported; `unseen` counts changes that the format cannot
reveal (one number that became another, in a format without a checksum).
"""

from __future__ import annotations

import argparse
import json
import queue
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1]))  # hdf5_files

from pliant.errors import PliantError

OUTCOMES = ("right", "refused", "told", "unseen", "silent", "crash", "signal", "hang")
START = 60.0  # s, for the start of a helper, compilation included
BAD = ("silent", "crash", "signal", "hang")


def work(kind: str, first: int, last: int, seed: int) -> None:
    """Run attempts first to last - 1 of a kind in the helper process, and print one line of JSON for each."""
    import forked

    with tempfile.TemporaryDirectory() as name, forked.forked():
        attempt = attempts(kind, Path(name))
        for number in range(first, last):
            result, sentence = attempt(np.random.default_rng([seed, number]))
            print(json.dumps([number, result, sentence[:300]]), flush=True)


def attempts(kind: str, folder: Path):
    """Return the function that makes one attempt from random numbers."""
    import hostile

    if kind in hostile.ATTEMPTS:
        return lambda rng: hostile.ATTEMPTS[kind](rng, folder)
    import mutations

    original = next(o for o in mutations.originals(folder) if o.name == kind)
    whole = mutations.read_whole(original, folder)

    def attempt(rng: np.random.Generator) -> tuple[str, str]:
        data, what, at = mutations.damaged(original, rng)
        result, sentence = mutations.outcome(original, data, what, at, whole, folder)
        return result, f"{what} at {at}: {sentence}"

    return attempt


def watched(kind: str, count: int, seed: int, patience: float, until: float) -> tuple[Counter, list[str]]:
    """Run all attempts of a kind, and restart the helper process after every attempt that ended it."""
    counted, bad, number = Counter(), [], 0
    while number < count and time.monotonic() < until:
        command = [sys.executable, __file__, "--work", kind, str(number), str(count), str(seed)]
        helper = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        lines: queue.Queue[str | None] = queue.Queue()
        threading.Thread(target=_pump, args=(helper.stdout, lines), daemon=True).start()
        wait = patience + START
        while True:
            try:
                line = lines.get(timeout=wait)
            except queue.Empty:
                result, sentence, line = "hang", f"no answer within {wait:g} s", None
                helper.kill()
            else:
                if line is None:
                    result, sentence = "signal", f"the helper ended with {helper.wait()}"
            if line is None:
                break
            wait = patience
            number, result, sentence = json.loads(line)
            number += 1
            counted[result] += 1
            if result in BAD:
                bad.append(f"{kind}, seed {seed}, {number - 1}: {result}: {sentence}")
            if number >= count or time.monotonic() > until:
                helper.kill()
                break
        helper.wait()
        if line is None and number < count:
            counted[result] += 1
            bad.append(f"{kind}, seed {seed}, {number}: {result}: {sentence}")
            number += 1
    return counted, bad


def _pump(stream, lines: queue.Queue) -> None:
    with stream:
        for line in stream:
            lines.put(line)
    lines.put(None)


def table(rows: dict[str, Counter]) -> str:
    """Return the outcomes by kind as Markdown."""
    head = ["", "tried", *OUTCOMES]
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += [f"| {kind} | {c.total()} | " + " | ".join(str(c[o]) for o in OUTCOMES) + " |" for kind, c in rows.items()]
    return "\n".join(lines)


def shares(files: int, hdf5: int = 0) -> dict[str, int]:
    """Return the number of attempts for each format: `files` over all formats, or `hdf5` over HDF5 formats."""
    import mutations

    with tempfile.TemporaryDirectory() as name:
        names = [o.name for o in mutations.originals(Path(name))]
    names = list(mutations.HDF5) if hdf5 else names
    return {n: max(1, (hdf5 or files) // len(names)) for n in names}


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--files", type=int, default=0)
    parser.add_argument("--hdf5", type=int, default=0, help="files of the HDF5 readers alone")
    parser.add_argument("--models", type=int, default=0)
    parser.add_argument("--loop", action="store_true")
    parser.add_argument("--prices", action="store_true")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--patience", type=float, default=5.0, help="s that one attempt may take")
    parser.add_argument("--json", type=Path)
    asked = parser.parse_args()
    until = time.monotonic() + 60 * asked.minutes
    kinds = shares(asked.files, asked.hdf5) if asked.files or asked.hdf5 else {}
    if asked.models:
        kinds |= {"model files": asked.models // 4, "studies": asked.models // 4, "packets": asked.models,
                  "free motions": asked.models // 2}  # fmt: skip
    rows, bad = {}, []
    for kind, count in kinds.items():
        longer = 6 if kind in ("model files", "free motions") else 1  # they compile
        rows[kind], more = watched(kind, count, asked.seed, longer * asked.patience, until)
        bad += more
        print(f"{kind}: {dict(rows[kind])}", file=sys.stderr, flush=True)
    if rows:
        print(table(rows))
    for line in bad:
        print(f"- {line}")
    if asked.loop or asked.prices:
        import hostile

        for wanted, make in ((asked.loop, hostile.loop_table), (asked.prices, hostile.prices)):
            if wanted:
                print(make())
    if asked.json:
        asked.json.write_text(json.dumps({"rows": rows, "bad": bad}, indent=1))
    sys.exit(bool(bad))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--work"]:
        work(sys.argv[2], *map(int, sys.argv[3:6]))
    else:
        try:
            main()
        except PliantError as error:
            sys.exit(str(error))
