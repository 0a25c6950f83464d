"""Messages, geometry, time and errors; every other package may import it, and it imports none of them."""
