"""Quality of a model: metrics on training and held-out recordings, and figures for papers."""
