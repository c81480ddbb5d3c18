"""Pictures of a marble with known places, and how trackers do on them."""
