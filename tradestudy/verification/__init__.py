"""Hard and published cases as data and functions."""
