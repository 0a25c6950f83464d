"""One trial, one viewing: the only rooms that know all the others."""
