"""Computes a study, one results group after another."""
