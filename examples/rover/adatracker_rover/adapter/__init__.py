"""The part that runs on a real robot; imports nothing of the simulator."""
