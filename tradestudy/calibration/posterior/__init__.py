"""Posteriors of calibrations: a normal approximation, chains of emcee, and what shows that they have converged."""
