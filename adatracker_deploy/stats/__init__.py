"""Statistics of few trials: intervals, exact tests, survival. Pure functions of numbers; knows no trials.

The formulas are few and exact, so they are written out here, each with its source.
"""
