"""How good a model is: metrics on training and held-out recordings, and figures for papers."""
