"""Physical effects as slots: one model is chosen for each."""
