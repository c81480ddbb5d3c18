"""The proof on a real rig: the measured tilt is the sealed label of a diagnosis that never sees it."""
