"""Many simulations at once: on SIMD vectors, all cores or a GPU."""
