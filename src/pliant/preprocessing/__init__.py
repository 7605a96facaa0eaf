"""Functions that check, repair, align, synchronise and resample a recording before a model is fitted to it."""
