"""Sweeps over parameters, on cores or a cluster, that survive a lost worker."""
