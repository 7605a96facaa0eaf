"""How one text becomes what runs: compiled twins, straight lines, SIMD lanes, and the choice among them."""
