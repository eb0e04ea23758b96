"""Results as text, JSON and table rows: one module per result type."""
