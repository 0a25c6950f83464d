"""Values that travel, geometry, time and errors: what every other room may import."""
