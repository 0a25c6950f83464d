"""Training: an agent, two methods, and runs that can be resumed."""
