"""Training: an agent, two methods that improve it, and a run that goes on where it was interrupted."""
