"""The operator's page: what a browser of this machine is shown, and what it may ask for."""
