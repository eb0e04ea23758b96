"""Placeholder until the API stands."""
