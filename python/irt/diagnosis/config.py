"""Settings of the search for the most probable set of effects, with units and reasons."""

from __future__ import annotations

#: Initial spectral densities of the random push in fits of the five parameters [m^2/s^3]: from 1/100 of the
#: detection limit of a good tracker to values that dominate the drive. The posterior has a mode in each
#: regime.
PUSHES = (1e-8, 1e-6, 1e-4, 1e-2)
#: Standard deviation of the start velocity [m/s]: a marble that is let go, or rolls at the start.
START_VELOCITY = 0.3
#: Initial white and correlated noise of the measured tilt [rad], and correlation time of the latter [s]: as
#: of markers under a webcam, and of servos that follow.
TILT = (1e-3, 3e-3, 0.2)
#: Initial spinning friction [radii]; the middle value is that of steel on wood, by Hertz.
SPINNING = (1e-4, 5e-4, 2.5e-3)
#: Initial standard deviation of the time at which a marble leaves a turning wall [s].
DEPARTURE = 0.01
#: Initial standard deviation of the time at which a marble that friction holds breaks away [s].
RELEASE = 0.01
#: Standard deviation of jittered delays [s] in a fit that starts without jitter.
KICK = 0.01
#: Draws of each effect in the screening.
DRAWS = 32
#: Most refinements of the draws of a one-parameter effect whose neighbouring draws differ completely.
FINER = 4
#: Effects that are fitted after the screening, and starts of each.
FITTED, STARTS = 10, 2
#: Effects that are fitted as replacements of an effect of a set.
SWAPPED = 3
#: Steps of all starts of an effect, of the best starts, and of a thorough fit.
BEGUN, FIRST, THOROUGH = 4, 10, 40
#: Starts that take more steps, and sets that are fitted thoroughly.
SECOND, TOPS = 6, 2
#: White push [m^2/s^3], correlated push [m/s^2] and standard deviation of the coefficient of restitution of a
#: complete model: the differences between engines.
LITTLE = (1e-10, 1e-4, 0.02)
#: Smallest gain of an effect that is named even if held-out recordings do not agree [nats]: odds of 99 to 1.
SURE = 4.6
#: Initial standard deviation [m/s^2] and correlation time [s] of the correlated push.
PULL, PULL_S = 3e-3, 0.2
#: Smallest gain of a replacement [nats]; smaller differences are within the tolerance of the fits.
BETTER = 0.5
#: Number of terms in the library of learned corrections, all equally probable.
LIBRARY = 1e4
#: Initial standard deviations and means of jittered delays [s].
KICKS, MEANS = (0.003, 0.01, 0.03, 0.1), (0.0005, 0.03, 0.1)
#: Largest ratio of the spread of delays to their mean: 1 for exponential delays, and up to 2 where later
#: commands overtake earlier ones.
SPREAD = 2.5
#: Residuals exceed the tracker's noise if their standard deviation is larger by this share: sqrt(2) - 1, as
#: if the variance doubled.
EXCEEDS = 0.41
#: Smallest increase of the mean absolute held-out error without an effect, as a share of the standard
#: deviation of the tracker's noise: the same for normal noise, (sqrt(2) - 1) sqrt(2 / pi).
MATTERS = 0.33
#: Smallest probability of effects and sets that are mentioned, and most sets that are kept as plausible.
MENTIONED, PLAUSIBLE = 0.01, 6
#: Largest difference of log posteriors between sets that tie for any held-out errors [nats]: odds of 20 to 1.
#: A larger one is enough for one more effect if the held-out recordings agree on it.
TIE = 3.0
#: A law of impacts is distinct from the contact solver of an engine if its interval is farther than this from
#: neutral, as a share of its range: walls without restitution are fitted as 0.05 to 0.11 in rapier.
LEAST_OF_IMPACTS = 0.15
#: Steps of a fit without one recording; it starts at the fit to all recordings.
REFIT = 12
#: Two names of an effect are equivalent if most rows differ by less than this share of the tracker's noise.
SAME = 0.1
#: An effect is fitted if its screened gain is at least this share of the largest, and at least this [nats].
PROMISING, LEAST = 0.02, 1.0
#: Sets within this distance of the best, or of the set to beat [nats], and the five parameters alone are
#: refitted until converged, at most this number of times.
NEAR, AGAIN = 60.0, 6
#: Starts that are drawn from the posterior of a set, because there are more maxima close to the one found.
SHAKEN = 4
#: Most local maxima of the five parameters alone that are screened.
MAXIMA = 6
#: Largest difference of scores at which held-out errors decide [nats]; engines with equal physics differ by
#: as much.
CLOSE = 20.0
#: Horizon of the windows in the error budget [s].
HORIZON_S = 1.0
#: Smallest remaining share of the five parameters' held-out error at which a correction is learned.
WORTH = 0.1
#: Smallest explained share of the marble's motion at which anything is named, or the five parameters are
#: sufficient: most of it.
EXPLAINED = 0.5
#: Smallest probability at which an effect is named, by itself or with its ties.
PROBABLE = 0.95
