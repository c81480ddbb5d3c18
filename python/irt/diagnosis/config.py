"""Every knob of the search for the most probable set of effects, with its unit and its reason."""

from __future__ import annotations

#: Spectral densities of the push at which an ascent of the five parameters begins [m^2/s^3]: from a hundredth
#: of what a good tracker sees to what overwhelms the drive. The hill has a top for each regime.
PUSHES = (1e-8, 1e-6, 1e-4, 1e-2)
#: Standard deviation of the start velocity [m/s]: a marble that is let go, or rolls as the recording begins.
START_VELOCITY = 0.3
#: Friction against spins about the vertical [radii] at which an ascent begins: the middle one is that of
#: steel on wood, by Hertz.
SPINNING = (1e-4, 5e-4, 2.5e-3)
#: Standard deviation of the time at which a marble leaves a wall that turns [s], where an ascent begins.
DEPARTURE = 0.01
#: Draws of each effect that are looked at to first order.
DRAWS = 32
#: Times that draws of an effect of one parameter are doubled where neighbours have nothing in common.
FINER = 4
#: Effects that are fitted after that look, and starts of each.
FITTED, STARTS = 10, 2
#: Effects that are fitted in the place of one of a set.
SWAPPED = 5
#: Steps that all starts of an effect take, that the best of them take, that the five parameters take from
#: each start, and that a thorough ascent takes at most.
BEGUN, FIRST, FIRST_OF_BASE, THOROUGH = 2, 6, 10, 25
#: How many starts take more steps, and how many sets are fitted thoroughly.
SECOND, TOPS = 6, 2
#: Push [m^2/s^3], push that lasts [m/s^2] and standard deviation of the coefficient of restitution on a rig
#: that lacks nothing: what engines differ by.
LITTLE = (1e-10, 1e-4, 0.02)
#: By so many nats a set must be likelier than without an effect for it to be named: odds of 99 to 1.
SURE = 4.6
#: Standard deviation [m/s^2] and time [s] of the push that lasts at which an ascent begins.
PULL, PULL_S = 3e-3, 0.2
#: By so many nats one set must be likelier to take the place of another: less is the ascents' own tolerance.
BETTER = 0.5
#: Terms of the library of what can be learned without a name, as a power of ten: each is as likely.
LIBRARY = 1e4
#: Standard deviations of delays that differ, and their means, at which an ascent may begin [s].
KICKS, MEANS = (0.003, 0.01, 0.03, 0.1), (0.0005, 0.03, 0.1)
#: The most that the spread of delays is of their mean: exponential ones have 1, and up to 2 is seen where
#: later commands overtake earlier ones.
SPREAD = 2.5
#: Share of the tracker's noise by which the error on runs held out must grow without an effect: as much as if
#: the tracker's variance doubled, sqrt(2) - 1.
MATTERS = 0.41
#: Effects, and sets of them, that are less probable than this are not mentioned; and so many sets at most are
#: to be distinguished by the next run.
MENTIONED, PLAUSIBLE = 0.01, 6
#: Sets whose log posteriors are no farther apart may not be distinguishable [nats]: odds of 20 to 1.
TIE = 3.0
#: Share of the range from which on a law of impacts is distinct from how an engine solves contacts: rapier's
#: walls without restitution are fitted as 0.05 to 0.11 of it.
LEAST_OF_IMPACTS = 0.15
#: Steps of a fit without one recording: it begins where all recordings led.
REFIT = 6
#: Two names of one thing predict alike where most rows differ by less than this share of the tracker's noise.
SAME = 0.1
#: Effects are fitted that promise this share of the most promising one's nats, and one nat.
PROMISING, LEAST = 0.02, 1.0
#: Sets so close to the best, or to what they are to beat, are fitted until nothing is gained [nats], so many
#: times at most.
NEAR, AGAIN = 60.0, 3
#: Between sets so close recordings held out decide: engines that agree in physics differ by this much [nats].
CLOSE = 20.0
#: How far ahead windows predict in the error budget [s].
HORIZON_S = 1.0
#: Share of the five parameters' error on recordings held out from which on physics without a name is sought.
WORTH = 0.1
#: Probability from which on an effect is named, by itself or as one of those that do as well.
PROBABLE = 0.95
