"""What a sweep counts, in integers, and what the counts say: shares, quantiles, rankings."""
