"""The sections of a report: each turns groups of the results into blocks, and is empty if its group is missing."""
