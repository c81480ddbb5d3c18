"""Optional packages: the extra of `labsim-irt` that installs each, and the error if one is missing."""

from __future__ import annotations

from importlib.util import find_spec

from irt.errors import IrtError

#: Title of each optional package and the extra that installs it, by import name.
OPTIONAL = {
    "cv2": ("OpenCV", "track"),
    "cyclonedds": ("Cyclone DDS", "ros"),
    "gymnasium": ("Gymnasium", "gym"),
    "mcap_ros2": ("mcap-ros2-support", "ros"),
    "mujoco": ("MuJoCo", "prove"),
    "pybullet": ("PyBullet", "prove"),
    "pysindy": ("PySINDy", "prove"),
    "ray": ("Ray", "cluster"),
    "rosbags": ("rosbags", "ros"),
    "sbi": ("sbi", "paper"),
    "torch": ("PyTorch", "train"),
}


def is_installed(package: str) -> bool:
    """Return whether a package can be imported, without importing it."""
    return find_spec(package) is not None


def install_command(package: str) -> str:
    """Return the command that installs an optional package, such as ``pip install 'labsim-irt[train]'``."""
    return f"pip install 'labsim-irt[{OPTIONAL[package][1]}]'"


def require(package: str, user: str) -> None:
    """Check that an optional package is installed; call it before the import.

    Parameters
    ----------
    package : str
        Import name of the package, a key of `OPTIONAL`.
    user : str
        Name of the feature that needs it, such as ``"irt track"``.

    Raises
    ------
    IrtError
        If it is not installed; the message contains the command that installs it.
    """
    if not is_installed(package):
        raise IrtError(f"{user} needs {OPTIONAL[package][0]}: {install_command(package)}")
