"""Results as tables of rich: one module per type of result."""
