"""Building blocks of study files: parts, quantities with units, and mistakes with their line and column."""
