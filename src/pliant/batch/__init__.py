"""Many simulations at once: on SIMD lanes, all cores or a GPU."""
