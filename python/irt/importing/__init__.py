"""From what a rig or another lab logged to recordings: `irt import`."""

from irt.importing.own_bags import Imported, Knobs, import_bags

__all__ = ["Imported", "Knobs", "import_bags"]
