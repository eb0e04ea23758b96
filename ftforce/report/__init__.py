"""Results as words, JSON and rows: one module per type of result."""
