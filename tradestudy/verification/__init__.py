"""Hard cases as data and functions."""
