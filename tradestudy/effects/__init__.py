"""Which effects a scene needs: slots of effects, models with bounds and costs, and the choice among them."""
