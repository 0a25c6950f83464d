"""Settings as typed, range-checked values: the schema, YAML, limits, profiles."""
