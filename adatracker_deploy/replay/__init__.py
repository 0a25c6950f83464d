"""Re-runs policy and gate on a trial's log. It moves nothing."""
