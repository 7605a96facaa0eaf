"""Source text of exported JAX modules. `pliant.exporters.jax_module` joins these files to one that imports jax alone.

`structure` holds the constants of one model, which the export replaces. The functions are the same for all models.
"""
