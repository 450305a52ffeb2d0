"""From a study file to validated values, and to the same study under other values."""
