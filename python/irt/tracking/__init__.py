"""From pictures to positions: the board's corners, the marble, and the plane between them."""

from irt.tracking.detect import Tracker, find_corners, find_marble, positions

__all__ = ["Tracker", "find_corners", "find_marble", "positions"]
