"""Selection of the terms of a model from training recordings alone."""
