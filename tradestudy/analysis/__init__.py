"""What a study asks of its cameras: depth, usable ranges, decisions, claims, requirements, depth of field."""
