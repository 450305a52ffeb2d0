"""The groups of the results tree, one file each: what was computed, with its dimensions."""
