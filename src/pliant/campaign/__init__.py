"""Many simulations: batches on SIMD lanes and all cores, sweeps over machines, and what it all costs."""
