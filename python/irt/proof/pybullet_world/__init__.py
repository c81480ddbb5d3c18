"""The concealed world: rigs in PyBullet or MuJoCo with hidden physics, written from the physics alone.

Nothing here imports `irt`, whose catalogue it examines. Only names, units and signs of effects are the same,
so that answers can be compared with labels.
"""
