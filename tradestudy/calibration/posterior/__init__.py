"""Posteriors of calibrations: a normal approximation, chains of emcee, and diagnostics of their convergence."""
