"""What a machine and a robot must be like before a trial, and how to mend what is not."""
