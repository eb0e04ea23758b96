"""Over time: paths and recordings, faults that happen on the way, histories and timelines."""

from ftforce.trajectory.fault_events import FaultEvent
from ftforce.trajectory.path import Path
from ftforce.trajectory.recording import Recording

__all__ = ["FaultEvent", "Path", "Recording"]
