"""The cameras as frozen types of SI floats."""
