"""What `python benchmarks/run.py` measures beside the kernels: whole motions, fits, batches, real time."""
