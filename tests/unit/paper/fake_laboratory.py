"""A laboratory that records the rolling engine with a lag, in no time."""

import json
import sys
from pathlib import Path

import numpy as np

from irt.engine import paper_drive, rollouts
from irt.recording import save_recording

for line in sys.stdin:
    asked = json.loads(line)["record"]
    folder = Path(asked["folder"])
    random = np.random.default_rng(asked["rig"])
    truth = np.array([[0.06, 0.04, 3e-4, 20.0 + asked["rig"], 1.05]])
    for place, name in ((folder, "paper-1"), (folder / "heldout", "paper-3")):
        place.mkdir(parents=True, exist_ok=True)
        seen = rollouts(truth, paper_drive(), effects=[{"name": "lag", "time_constant_s": 0.2}])[0]
        save_recording(
            place / f"{name}.csv", paper_drive(), seen + 0.001 * random.standard_normal(seen.shape)
        )
    effects = [{"name": "lag", "time_constant_s": 0.2}, {"name": "delay_jitter", "sd_s": 0.1}]
    print(json.dumps({"truth": {"effects": effects}}), flush=True)
