"""Simulation over time: paths and recordings, fault events, histories and timelines."""

from ftforce.trajectory.fault_events import FaultEvent
from ftforce.trajectory.path import Path
from ftforce.trajectory.recording import Recording

__all__ = ["FaultEvent", "Path", "Recording"]
