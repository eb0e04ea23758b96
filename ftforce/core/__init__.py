"""The mathematics: arrays only, so that it can be used with any robotics library."""
