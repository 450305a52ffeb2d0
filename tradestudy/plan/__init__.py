"""Which effects a run will simulate, which it leaves out and why, and how long it will take."""
