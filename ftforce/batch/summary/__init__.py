"""Integer counts of a sweep, and statistics from them: shares, quantiles, rankings."""
