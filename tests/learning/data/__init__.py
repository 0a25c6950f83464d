"""Training data: recipes, collection, visited states, sequences."""
