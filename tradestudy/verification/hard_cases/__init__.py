"""Hard cases: inputs at which formulas break down, computed by the textbook formula and by this program's.

Both formulas are evaluated in every run and compared with references of thirty digits, which are stored. Each family
has its own file.
"""
