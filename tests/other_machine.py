"""Two programs on two machines, as far as a claim on one machine can tell."""


class OfAnotherMachine:
    """A `Claim` that nobody here sees."""

    def __init__(self, robot):
        pass

    def close(self):
        pass
