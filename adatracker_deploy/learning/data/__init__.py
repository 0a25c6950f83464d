"""Training data: recipes, the perturbed expert, shards of episodes on disk, and sequences sampled from
them."""
