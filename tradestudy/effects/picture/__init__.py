"""Slots of a picture that depth is measured from: what each would do to the disparity error that is derived from it."""
