"""Which effects a scene needs: their models, and the choice of the cheapest ones within the tolerance."""
