"""Answers to a study's questions: depth, usable ranges, decisions, claims, requirements, depth of field."""
