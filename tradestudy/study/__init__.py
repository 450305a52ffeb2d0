"""Read and validate a study file, and give the same study other values."""
