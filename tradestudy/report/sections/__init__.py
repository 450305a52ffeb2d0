"""The sections of a report: each turns groups of the results into blocks, and says nothing if its group is missing."""
