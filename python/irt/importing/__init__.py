"""`irt import`: from logs of a rig or of another lab to recordings."""

from irt.importing.own_bags import Imported, Knobs, import_bags

__all__ = ["Imported", "Knobs", "import_bags"]
