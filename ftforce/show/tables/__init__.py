"""Results as rich tables: one module per result type."""
