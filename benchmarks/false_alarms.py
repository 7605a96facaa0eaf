"""Count false alarms of the contact test over hours of free motion, with many sets of sensors.

    python benchmarks/false_alarms.py -o results/false_alarms --seeds 20 --minutes 60     # 20 h; resumable

One minute of motion of actuator a, b or c (pulses, ramps and pauses of random levels and lengths) is simulated once and
measured by every seed of that actuator. Seeds are sets of sensors (`benchmarks/touches.py`). Each seed learns its
thresholds from four other minutes, for one alarm an hour and for lower rates (`RATES`). The hours are therefore hours
of the sensors; the motions differ from minute to minute, but not from seed to seed. A simple threshold on the same
torques, for one alarm an hour, serves for comparison. No setting was tuned on these motions or seeds.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache

import chunks
import numpy as np
import xarray as xr
from state import LATENCY, NOISE, model
from touches import LEARN, Plain, free, free_minute, seen

from pliant.contact import find_contact
from pliant.contact.contact import filtered_free_motion, free_motion_for_rate
from pliant.contact.free_motion import FreeMotion
from pliant.sweep.store import Arrays

NAMES = "abc"
RATES = (1.0, 0.5, 0.25, 0.1)  # alarms asked for in an hour
FIRST = 1000  # of the minutes that nobody learnt from


@cache
def learnt(name: str, seed: int) -> tuple[FreeMotion, np.ndarray, Plain]:
    """Return what both tests learn from free motion with the sensors of a seed, with thresholds for all `RATES`."""
    bodies = [seen(free(name, k), name, seed, f"free_{k}") for k in range(LEARN)]
    chain, options = model(name), {"noise": NOISE, "latency": LATENCY[name]}
    shown = filtered_free_motion(bodies, chain, **options)
    tests = [free_motion_for_rate(shown, rate) for rate in RATES]
    thresholds = np.array([t.sudden.threshold for t in tests])
    return tests[0], thresholds / thresholds[0], Plain.learnt(bodies, chain, options)


@dataclass(frozen=True)
class Minutes(chunks.OneByOne):
    """Chunks of one minute of one actuator, under all its seeds."""

    seeds: int = 20

    def work(self, chunk: int) -> Arrays:
        """Return alarms of both tests (1, seeds) and for each of `RATES`; NaN for seeds of other actuators."""
        began, name = time.process_time(), NAMES[chunk % len(NAMES)]
        k = FIRST + chunk // len(NAMES)
        motion, options = free_minute(name, k), {"noise": NOISE, "latency": LATENCY[name]}
        made = {what: np.full((1, self.seeds), np.nan) for what in ("alarms", "plain_alarms")}
        made["heard"] = np.full((1, self.seeds, len(RATES)), np.nan)
        for seed in range(NAMES.index(name), self.seeds, len(NAMES)):
            test, thresholds, plain = learnt(name, seed)
            body = seen(motion, name, seed, f"minute_{k}")
            found = find_contact(body, model(name), free=test, **options)
            made["alarms"][0, seed] = len(found.attrs["alarm_s"])
            made["heard"][0, seed] = float(found["statistic"].max()) > thresholds
            made["plain_alarms"][0, seed] = plain.alarms(body).size
        return {**made, "cpu_s": np.array([time.process_time() - began])}


def table(samples: xr.Dataset) -> str:
    """Return alarms per hour by actuator and by seed."""
    lines = []
    for what, words in (("alarms", "likelihood ratio"), ("plain_alarms", "plain threshold")):
        by_seed = samples[what].sum("sample").values
        hours = samples[what].notnull().sum("sample").values / 60.0
        every = by_seed.sum()
        lines.append(f"{words}: {every:.0f} alarms in {hours.sum():.1f} h, {every / hours.sum():.2f} an hour")
        for name in NAMES[: by_seed.size]:
            mine = slice(NAMES.index(name), None, len(NAMES))
            rate = by_seed[mine].sum() / max(hours[mine].sum(), 1e-9)
            each = ", ".join(f"{v:.0f}" for v in by_seed[mine])
            lines.append(f"  {name}: {rate:.2f} an hour; by seed, each {hours[mine].max():.1f} h: {each}")
        late = np.arange(by_seed.size) >= 10
        for title, part in (("seeds 0 to 9", ~late), ("seeds 10 to 19", late)):
            if part.any():
                lines.append(f"  {title}: {by_seed[part].sum():.0f} in {hours[part].sum():.1f} h")
    heard, late = samples["heard"].values, np.arange(samples["heard"].shape[1]) >= 10
    for r, rate in enumerate(RATES):
        said = (f"{np.nansum(heard[:, part, r]):.0f} in {np.isfinite(heard[:, part, r]).sum() / 60.0:.1f} h"
                for part in (~late, late) if part.any())  # fmt: skip
        lines.append(f"asked for {rate:g} an hour, minutes with an alarm, seeds 0 to 9, 10 to 19: {', '.join(said)}")
    return "\n".join(lines)


def main() -> None:
    """Compute missing minutes, then print the table."""
    parser = chunks.options(__doc__, "false_alarms", 20)
    parser.add_argument("--minutes", type=int, default=60, help="of motion that each seed sees")
    args = parser.parse_args()
    work = Minutes(len(NAMES) * args.minutes, args.seeds)
    print(table(chunks.samples(work, {"sweep": "false alarms", "seeds": args.seeds}, args)))


if __name__ == "__main__":
    main()
