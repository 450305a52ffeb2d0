"""From a study file to results: schema, reader, quantities, runner."""
