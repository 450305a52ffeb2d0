"""The groups of the results tree, one file each: the computed values with their dimensions."""
