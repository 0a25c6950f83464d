"""MR, EL, AR and SR: metrics, summaries, comparisons and their statistics."""
