"""What accuracy costs: error against seconds, measured, for every model and setting that can answer a question."""
