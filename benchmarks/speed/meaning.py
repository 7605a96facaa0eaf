"""What each number of the benchmark means, by its name."""

from __future__ import annotations

from speed.measure import MEANING as OF_THE_KERNELS

MEANING = {
    **OF_THE_KERNELS,
    "experiment_ms": "the paper's pulse of 4 s at the coarsest step that keeps all tips within the target",
    "experiment_tip_error_mm": "largest distance of a tip from the reference solution at that step",
    "experiment_step_ms": "that step", "experiment_labelled_ms": "the same through pliant.simulate, labels included",
    "ratio_lsoda": "times as long as pliant takes for the same error", "ratio_mujoco": "the same",
    "lsoda": "what the ratio was measured with", "mujoco": "the same",
    "batch_speedup_simd": "one core with lanes against a plain loop of the compiled march",
    "batch_speedup_cores": "two cores against one", "batch_cores": "cores of that",
    "batch_speedup_all_cores": "all cores against one", "batch_all_cores": "cores of that",
    "batch_speedup_over_simulate": "two cores and lanes against pliant.simulate",
    "batch_over_c": "one step of one sample on one core, times the lanes of its registers, over a step in plain C",
    "batch_lanes": "doubles in a register of this processor",
    "batch_memory_share": "bytes of its result over those that one core reads and writes in its time",
    "memory_gb_s": "copied by one core: read and written",
    "batch_us_per_sample": "one sample of the paper's pulse, all cores",
    "batch_ns_per_step_one_core": "one step of one sample, one core, everything counted",
    "batch_difference_mm": "largest distance from single runs", "batch_times_real_time": "simulated over elapsed time",
    "realtime_median_us": "what Stepper.step takes from Python, once a period",
    "realtime_p999_us": "99.9 % of the steps take no longer", "realtime_worst_us": "the longest",
    "realtime_missed": "steps that were not done when the next was due",
    "realtime_missed_by_an_empty_loop": "by the same loop with no step in it, in turns with the steps",
    "realtime_missed_by_the_system": "of those, steps that began late: the system gave the process no time",
    "realtime_steps": "how many", "realtime_late_p999_us": "99.9 % of the steps began no later than this",
    "realtime_seconds": "how long", "realtime_period_ms": "between two steps",
    "realtime_bytes_left": "memory that 20 000 steps keep",
}
