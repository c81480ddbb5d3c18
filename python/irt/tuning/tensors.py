"""Files of tensors: networks and checkpoints as safetensors, read and written with numpy alone."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from irt.errors import IrtError
from irt.files import PathLike, write_atomic

#: The type of a network's weights and activations.
Floats = NDArray[np.float32]

#: The entry of a safetensors header that holds all metadata, as JSON.
_METADATA = "irt"


def write_tensors(path: PathLike, tensors: Mapping[str, NDArray[Any]], metadata: Mapping[str, str]) -> None:
    """Write arrays as safetensors, atomically.

    Raises
    ------
    IrtError
        If the file cannot be written.
    """
    plain = {name: np.array(value, order="C") for name, value in tensors.items()}
    # In one entry, because the order of several entries changes from run to run.
    write_atomic(path, save(plain, {_METADATA: json.dumps(metadata, sort_keys=True)}))


def read_tensors(path: PathLike) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Read the arrays and the metadata of a safetensors file.

    Raises
    ------
    IrtError
        If the file is missing, cut short or no safetensors file.
    """
    if not Path(path).is_file():
        raise IrtError(f"{path}: no such file")
    try:
        with safe_open(path, framework="np") as file:
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118  # not a mapping
            metadata = dict(json.loads((file.metadata() or {}).get(_METADATA, "{}")))
    # For types that numpy lacks, and for metadata of another kind, there are errors of other kinds.
    except (
        SafetensorError,
        OSError,
        ValueError,
        TypeError,
        AttributeError,
        KeyError,
        RecursionError,
    ) as error:
        raise IrtError(f"{path}: cut short or no safetensors file ({error}); create it again") from error
    return tensors, metadata


def weights_of(
    path: PathLike, tensors: Mapping[str, NDArray[Any]], shapes: Mapping[str, tuple[int, ...]]
) -> dict[str, Floats]:
    """Return the weights of a network, named ``network.*`` in the file, in single precision.

    Parameters
    ----------
    path : path
        The file, for messages.
    tensors : mapping
        From `read_tensors`.
    shapes : mapping
        The weights that the network has, and their shapes.

    Raises
    ------
    IrtError
        If one is missing, has another shape or is not finite.
    """
    weights = {}
    for name, shape in shapes.items():
        found = tensors.get(f"network.{name}")
        if found is None or found.shape != shape:
            state = "missing" if found is None else f"of shape {found.shape}"
            raise IrtError(f"{path}: network.{name} is {state}; expected shape {shape}")
        if not np.isfinite(found).all():
            raise IrtError(f"{path}: network.{name} holds values that are not finite; train it again")
        weights[name] = found.astype(np.float32)
    return weights


def linear(weights: Mapping[str, Floats], name: str, values: Floats) -> Floats:
    """Return (k, n) outputs of the linear layer of that name for (k, m) inputs."""
    outputs: Floats = values @ weights[f"{name}.weight"].T + weights[f"{name}.bias"]
    return outputs


def linear_shapes(name: str, inputs: int, outputs: int) -> dict[str, tuple[int, ...]]:
    """Return the weights of a linear layer and their shapes, as PyTorch names and stores them."""
    return {f"{name}.weight": (outputs, inputs), f"{name}.bias": (outputs,)}


def checkpoint_path(path: PathLike) -> Path:
    """Return the path of a training's checkpoint: ``net.checkpoint.safetensors``."""
    path = Path(path)
    return path.with_name(f"{path.stem}.checkpoint.safetensors")
