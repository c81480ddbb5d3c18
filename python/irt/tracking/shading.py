"""The disc of a marble that looks like its board, by its shading and its shadow.

Painted like the wood that it rolls on, a marble has no rim of hue, and hardly one of light. What shows it is
that it is a ball: the light that a matt ball returns is a sum of nine spherical harmonics of its normal
(Ramamoorthi and Hanrahan, 2001), which has its steepest slopes at the rim; and its shadow on the board is an
ellipse that a lamp in one direction throws from where it stands. Both discs are laid at once,

    picture(p) = covered [sum of harmonics(normal)] + (1 - covered) board(p) [light - near - shadow]

with the harmonics and the strengths of light by least squares for each middle, direction and softness of the
shadow. What mirrors a lamp or a window is let go of.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from irt.tracking.appearance import FINE, Values
from irt.tracking.coverage import Laid
from irt.tracking.rims import POWER, light_of
from irt.tracking.shadow import BLACK

Array = NDArray[np.float64]

#: What lens and pixels blur (standard deviation) [pixels].
BLUR = 0.75
#: Directions of the shadow that are tried, and how far aside it lies, in radii: the last is that of a lamp 20
#: degrees above the board.
TURNS, ASIDE = 12, (0.5, 1.0, 1.7, 2.7)
#: Softness of a shadow's edge over the length of the ray that grazes the ball: the tangent of a lamp's half
#: width, its mean and standard deviation. A lamp of 10 cm at 0.7 m has 0.07.
SOFT, SOFT_ERROR = 0.08, 0.06
#: Standard error of the ball's middle along each axis where the marble has a hue of its own, or mirrors
#: [radii]: 0.19 for six marbles of steel in path-traced rooms, 0.03 in 20 drawn runs.
SHADED = 0.2
#: How well the middle of what is covered is known where marble and board look alike (standard deviation)
#: [radii].
COVERS = 0.15
#: The same where nothing is known of it.
FREE = 1.0
#: From here on a middle is another one [radii].
ELSEWHERE = 2.0 * COVERS
#: Which of two explanations leaves less decides, and this power of the ratio of what they leave is how much
#: likelier the better one is: by logistic regression over 95 discs, 1.4 to 1.6.
DECISIVE = 1.5
#: Standard error of a ball that only its shape and its shadow show [radii]: of 95 discs the median is off by
#: 0.06, and nine in ten by less than 0.22.
BY_SHAPE = 0.1
#: Samples to a radius that are looked at for it.
ACROSS = 3.0
#: So far from a picture's middle may be what is said to be in it, and how soft that limit is [radii]: two
#: things whose middles are a radius apart are both in the middle if neither is nearer.
ABOUT, WALL = 0.5, 0.02
#: Samples that err alike.
ALIKE = 20.0
#: Residuals at which a sample loses its say, in scatters.
LETS_GO = 3.0
#: Added to the scatter: what half a level of 255 is in dim light, as a share of full light.
LEAST = 0.0016
#: From here on levels are cut off [255 as full light]; below, a level hardly changes with the light.
FULL, DARK = 235.0, 2.55
#: Greatest weight of a dark sample over the median one.
MOST = 8.0
#: Rounds of letting go, and steps of the search in each.
ROUNDS, STEPS = 3, 250
#: A ball is matt if its shading leaves less than this share of its own light: matt paint leaves 0.03 to 0.05,
#: steel 0.09 to 0.15, and gloss that mirrors a lamp more.
MATT = 0.065


@dataclass(frozen=True)
class Shaded:
    """A ball laid over a picture by its shading.

    Attributes
    ----------
    x, y : float
        Its middle from that of the picture [pixels].
    scatter : float
        What the shading leaves of the ball's light, as a share of it.
    """

    x: float
    y: float
    scatter: float

    @property
    def matt(self) -> bool:
        """Whether shading explains the marble."""
        return self.scatter < MATT


@dataclass(frozen=True)
class Thrown:
    """A ball and the shadow that it throws.

    Attributes
    ----------
    ball : (dx, dy)
        The ball's middle from that of the picture [radii].
    shadow : float
        The chance that the shadow is in the picture's middle, and not the ball.
    apart : float
        How far the balls of the two explanations are apart [radii]; 0 if only one was laid.
    """

    ball: tuple[float, float]
    shadow: float
    apart: float = 0.0


def ball_by_shading(light: Values, board: Values, covers: Laid, foot: tuple[float, float]) -> Shaded:
    """Return the ball of known radius that explains a picture.

    Parameters
    ----------
    light, board : (n, n, 3) float32 arrays
        The usual picture, and the board there without a marble [light, to 255], `FINE` samples to a pixel.
    covers : Laid
        What the marble covers: its radius, and roughly its middle. On a board without texture its shadow
        covers as much; so the ball is looked for in the picture's middle as well.
    foot : (dx, dy)
        Where the marble touches the board, beside its middle in the picture [radii].
    """
    roughly = [covers]
    if np.hypot(covers.x, covers.y) > ELSEWHERE * covers.radius:
        roughly.append(Laid(0.0, 0.0, covers.radius, 0.0))
    found = [
        _Ball(light, board, one, foot).laid([(one.x, one.y, *aside) for aside in _asides()])
        for one in roughly
    ]
    return min(found, key=lambda one: one.left).ball


def ball_and_shadow(light: Values, board: Values, radius: float, foot: tuple[float, float]) -> Thrown:
    """Return where the ball is that is in a picture's middle, or throws the shadow there.

    Both explanations are laid: a ball about the middle with its shadow anywhere, and a shadow about the
    middle with its ball beside it. No sample loses its say: either would let go of the other thing.

    Parameters
    ----------
    light, board : (n, n, 3) float32 arrays
        The usual picture, and the board there without a marble [light, to 255].
    radius : float
        Of ball and shadow [samples].
    foot : (dx, dy)
        Where a marble touches the board, beside its middle in the picture [radii].
    """
    coarse = max(round(radius / ACROSS), 1)
    rows = slice(len(light) // 2 % coarse, None, coarse)
    light, board = light[rows, rows], board[rows, rows]
    asides = _asides()

    def laid(middle: str, starts: list[tuple[float, ...]]) -> _Laid:
        about = Laid(0.0, 0.0, radius, 0.0)
        ball = _Ball(light, board, about, foot, fine=1.0 / coarse, hold=FREE, middle=middle)
        return ball.laid(starts, all_of_it=True)

    here = laid("ball", [(0.0, 0.0, x, y) for x, y in asides])
    beside = laid("shadow", [(-radius * (x + foot[0]), -radius * (y + foot[1]), x, y) for x, y in asides])
    ratio = beside.left / here.left
    ball = (here if ratio > 1.0 else beside).ball
    apart = float(np.hypot(here.ball.x - beside.ball.x, here.ball.y - beside.ball.y))
    return Thrown((ball.x / radius, ball.y / radius), float(1.0 / (1.0 + ratio**DECISIVE)), apart / radius)


def thrown(pictures: Values, boards: Values, radius: float, foot: tuple[float, float]) -> Thrown:
    """Return `ball_and_shadow` of views laid over each other, with the boards there (v, n, n, 3) [levels].

    The ends of a board, lines and holes are elsewhere in each view, so that medians of pictures and of boards
    do not fit each other. What the views do to their own boards has a median.
    """
    board = np.asarray(np.median(boards, axis=0), dtype=np.float32)
    change = np.median((np.maximum(pictures, 0.0) + BLACK) / (np.maximum(boards, 0.0) + BLACK), axis=0)
    usual = np.asarray(change * (np.maximum(board, 0.0) + BLACK) - BLACK, dtype=np.float32)
    return ball_and_shadow(light_of(usual), light_of(board), radius, foot)


def _asides() -> list[tuple[float, float]]:
    """Return where shadows may be beside the foot of their ball [radii]."""
    turns = 2.0 * np.pi * np.arange(TURNS) / TURNS
    return [(aside * np.cos(turn), aside * np.sin(turn)) for turn in turns for aside in ASIDE]


@dataclass(frozen=True)
class _Laid:
    """A ball laid over a picture, and the squares that it leaves of all samples."""

    ball: Shaded
    left: float


class _Ball:
    """A picture, and what explains it."""

    def __init__(
        self,
        light: Values,
        board: Values,
        covers: Laid,
        foot: tuple[float, float],
        *,
        fine: float = FINE,
        hold: float = COVERS,
        middle: str = "",
    ) -> None:
        half = len(light) // 2
        down, right = np.mgrid[-half : half + 1, -half : half + 1] / fine
        self._hold, self._middle = hold, middle
        self._right, self._down = right.ravel(), down.ravel()
        self._picture = light.reshape(-1, 3).T.astype(np.float64) / 255.0
        self._board = board.reshape(-1, 3).T.astype(np.float64) / 255.0
        self._covers, self._foot = covers, foot
        # Noise is alike in levels: what counts is how much levels change with the light.
        level = np.maximum(self._picture, DARK / 255.0) ** (1.0 / POWER)
        weights = (level / np.maximum(self._picture, 0.01) / POWER) ** 2
        weights = np.minimum(weights / np.median(weights, axis=1, keepdims=True), MOST)
        self._weights = weights * (self._picture < FULL / 255.0).all(axis=0)
        self._trust = np.ones(len(self._right))
        self._scatter = 1.0

    def left_by(self, start: tuple[float, ...]) -> float:
        """Return the squares that a middle, and where its shadow is, leave."""
        return float(self._left(np.array([*start, SOFT]))[0].sum())

    def laid(self, starts: Sequence[tuple[float, ...]], *, all_of_it: bool = False) -> _Laid:
        """Return the ball that explains the picture best, or all of it where nothing may be let go of."""
        from scipy.optimize import minimize  # noqa: PLC0415

        covers = self._covers
        best = np.array([*min(starts, key=self.left_by), SOFT])
        step = 2.0 * self._hold
        for _ in range(ROUNDS):
            self._let_go(best)
            if all_of_it:
                self._trust = np.ones_like(self._trust)
            simplex = np.vstack([best, best + np.diag([step, step, 0.2, 0.2, 0.04])])
            options = {"initial_simplex": simplex, "xatol": 0.01, "fatol": 0.01, "maxfev": STEPS}
            best = minimize(self._misfit, best, method="Nelder-Mead", options=options).x
        inner = np.hypot(self._right - best[0], self._down - best[1]) < covers.radius
        left = self._left(best)[1]
        own = float(np.median(self._picture[:, inner])) + LEAST
        scatter = 1.48 * float(np.median(np.sqrt(left[inner]))) / own
        return _Laid(Shaded(float(best[0]), float(best[1]), scatter), float(left.sum()))

    def _let_go(self, at: Array) -> None:
        """Let go of samples that are not explained."""
        size = np.sqrt(self._left(at)[1])
        self._scatter = 1.48 * float(np.median(size)) + LEAST
        self._trust = 1.0 / (1.0 + (size / (LETS_GO * self._scatter)) ** 2) ** 2

    def _misfit(self, at: Array) -> float:
        """Return minus the logarithm of how likely a ball is [nats]."""
        covers = self._covers
        away = ((at[0] - covers.x) ** 2 + (at[1] - covers.y) ** 2) / (self._hold * covers.radius) ** 2
        if self._middle:
            there = at[:2] / covers.radius
            if self._middle == "shadow":
                away, there = 0.0, there + self._foot + at[2:4]
            away += (max(float(np.hypot(*there)) - ABOUT, 0.0) / WALL) ** 2
        soft = ((abs(at[4]) - SOFT) / SOFT_ERROR) ** 2
        return float(self._left(at)[0].sum() / self._scatter**2 / ALIKE + away + soft) / 2.0

    def _left(self, at: Array) -> tuple[Array, Array]:
        """Return the squares that are left of each colour (3,), and of each sample (n n,)."""
        inside, outside = self._parts(at)
        squares, each = np.zeros(3), np.zeros(len(self._right))
        for colour in range(3):
            design = np.concatenate([inside, outside * self._board[colour]])
            weights = self._weights[colour] * self._trust
            normal = (design * weights) @ design.T
            normal += 1e-4 * np.trace(normal) / len(normal) * np.eye(len(normal))
            answer = np.linalg.solve(normal, (design * weights) @ self._picture[colour])
            left = (self._picture[colour] - answer @ design) ** 2
            squares[colour] = weights @ left
            each += self._weights[colour] * left / 3.0
        return squares, each

    def _parts(self, at: Array) -> tuple[Array, Array]:
        """Return what the ball's light (9, n n), and the board's over its usual one (5, n n), are sums of."""
        from scipy.special import ndtr  # noqa: PLC0415

        x, y, aside_x, aside_y, soft = at
        radius = self._covers.radius
        u, v = (self._right - x) / radius, (self._down - y) / radius
        away = np.hypot(u, v)
        covered = ndtr((1.0 - away) * radius / BLUR)
        near = 4.0 / (1.0 + away**2) ** 2
        one = np.ones_like(u)
        up = np.sqrt(1.0 - np.minimum(away**2, 1.0))
        harmonics = [one, u, v, up, u * v, u * up, v * up, u * u - v * v, 3.0 * up**2 - 1.0]
        # The shadow's middle lies beside the foot; it is as broad as the ball, and longer away from the lamp.
        far = np.hypot(aside_x, aside_y) + 1e-6
        dx, dy = u - self._foot[0] - aside_x, v - self._foot[1] - aside_y
        along, across = (dx * aside_x + dy * aside_y) / far, (dy * aside_x - dx * aside_y) / far
        part = np.hypot(along / np.sqrt(1.0 + far**2), across)
        edge = np.hypot(BLUR / radius, soft * np.maximum(along + far, 0.1))
        # Light from a window on one side is taken on the other.
        dark = [one, near, near * u, near * v, ndtr((1.0 - part) / edge)]
        return covered * np.array(harmonics), (1.0 - covered) * np.array(dark)
