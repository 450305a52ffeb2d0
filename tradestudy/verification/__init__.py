"""Hard cases, at which textbook formulas break down: their inputs, both formulas and the verdicts."""
