"""What a scene calls for: slots of effects, models with bounds and costs, and the choice among them."""
