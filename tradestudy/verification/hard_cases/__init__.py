"""Hard cases: places where formulas break, computed by the usual formula and by ours, against thirty digits.

Formulas are computed anew at each run; only the references are stored. One file per family.
"""
