"""Functions that check, repair, align and synchronise a recording before a model is fitted to it."""
