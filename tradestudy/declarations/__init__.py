"""What every part of a study file is written in: parts, quantities with units, and mistakes with their place."""
