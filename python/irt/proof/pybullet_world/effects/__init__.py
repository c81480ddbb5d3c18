"""The effects of the catalogue that act in this world, each written from its physics."""

from __future__ import annotations

from ..physics import Physics
from .camera import CameraOffset, CameraRotation, LensDistortion, Parallax, Perspective
from .cord import Backlash, SpringHysteresis
from .friction import (
    AnisotropicFriction,
    FrictionPatch,
    QuadraticDrag,
    StaticFriction,
    Stribeck,
    ViscousDrag,
)
from .lever import CrossCoupling, GearAsymmetry, GearNonlinearity, TiltBias
from .marble import EccentricMarble, SideForce, WallRestitution
from .servo import CommandQuantisation, DeadBand, Lag, SlewLimit
from .shape import BoardWarp, Bump, PointField
from .timing import ClockDrift, Delay, DelayJitter, Latency

#: In the order in which they act, from the command to the picture.
EFFECTS: tuple[type[Physics], ...] = (
    Delay,
    DelayJitter,
    CommandQuantisation,
    DeadBand,
    SlewLimit,
    Lag,
    Backlash,
    SpringHysteresis,
    GearNonlinearity,
    GearAsymmetry,
    ClockDrift,
    CrossCoupling,
    TiltBias,
    BoardWarp,
    Bump,
    PointField,
    EccentricMarble,
    SideForce,
    StaticFriction,
    Stribeck,
    AnisotropicFriction,
    FrictionPatch,
    ViscousDrag,
    QuadraticDrag,
    WallRestitution,
    Latency,
    Parallax,
    Perspective,
    LensDistortion,
    CameraRotation,
    CameraOffset,
)

__all__ = ["EFFECTS"]
