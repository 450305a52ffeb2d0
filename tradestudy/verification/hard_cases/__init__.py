"""Hard cases: inputs at which formulas break, computed by the textbook formula and by ours, against thirty digits.

Both formulas are evaluated at each run; only the references are stored. One file per family.
"""
