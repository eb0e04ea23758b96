"""The version, where every module can reach it; pyproject.toml states the same."""

__version__ = "0.1.0"
