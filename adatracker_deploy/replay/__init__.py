"""Trials run again from their logs: what a policy answers, what the gate would send. It moves nothing."""
