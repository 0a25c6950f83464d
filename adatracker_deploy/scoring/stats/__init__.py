"""Statistics: intervals, exact tests and survival for few trials, and sums and quantiles of endless ticks.

Knows numbers and no trials. The formulas are few, so they are written out here, each with its source.
"""
