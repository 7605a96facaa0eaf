"""How one text becomes what runs: compiled twins, straight lines, SIMD vectors, and the choice among them."""
