"""The distribution of a camera's parameters, from corners, targets, files and posteriors."""
