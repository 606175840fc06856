"""The weights of one stage of an update: how much of the likelihood is taken, and what the cloud is then."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.compiling import compiled, inlined, summing
from quietfix.systems.kernels.particles.exponential import exponential
from quietfix.systems.kernels.particles.sums import largest, powers, product, total
from quietfix.systems.kernels.particles.weighing import spread

__all__ = ["exponents", "stage", "weights"]

_SMALLEST = 25.0  # no step is smaller than e^-25 of what remains: such a likelihood is sharper than a double can be
_EVALUATIONS = 7  # leave the effective share within some percent above what is asked for


@compiled("void(float64[:,::1],float64[:,::1],boolean[::1],float64[::1])")
def weights(logarithm: Any, weight: Any, alike: Any, log_sum: Any) -> None:
    """Write weights (trials, N) that sum to 1, and the logarithm of the sum of the given ones.

    Where all of a trial are 0, as after resampling, that it is `alike` is all that is written.
    """
    trials, count = logarithm.shape
    for t in range(trials):
        alike[t] = True
        for j in range(count):
            alike[t] &= logarithm[t, j] == 0.0
        log_sum[t] = math.log(count) if alike[t] else _normalise(logarithm[t], weight[t])


@inlined
def _normalise(logarithm: Any, weight: Any) -> float:
    highest = largest(logarithm)
    for j in range(weight.shape[0]):
        weight[j] = exponential(logarithm[j] - highest)
    whole = total(weight)
    scale = 1.0 / whole
    for j in range(weight.shape[0]):
        weight[j] *= scale
    return highest + math.log(whole)


@compiled(
    "void(float64[:,:,::1],float64[:,::1],int64[::1],boolean[::1],float64[:,::1],float64[::1],float64[:,::1],"
    "float64[:,::1],float64[:,::1],float64[:,::1],float64[:,:,::1],float64[::1],float64[::1])"
)
def stage(
    cloud: Any,
    before: Any,
    which: Any,
    alike: Any,
    logarithm: Any,
    step: Any,
    space: Any,
    after: Any,
    weight: Any,
    mean: Any,
    covariance: Any,
    effective: Any,
    log_sum: Any,
) -> None:
    """Weigh the clouds (all, n, N) of `which` trials by their likelihoods to the powers `step` (k,).

    `before` (all, N) are the logarithms of the weights so far, not read where they are `alike` (k,); `logarithm` (k, N)
    those of the likelihoods. Writes the logarithms `after` (k, N), the weights, which sum to 1, their effective number,
    the logarithm of their sum, mean and covariance. `space` is (n + 1, 512).
    """
    count = cloud.shape[2]
    for k in range(which.shape[0]):
        t, power, row = which[k], step[k], after[k]
        if alike[k]:
            for j in range(count):
                row[j] = power * logarithm[k, j]
        else:
            for j in range(count):
                row[j] = before[t, j] + power * logarithm[k, j]
        log_sum[k] = _normalise(row, weight[k])
        effective[k] = 1.0 / product(weight[k], weight[k])
        spread(cloud[t], weight[k], False, space, mean[k], covariance[k])


@compiled(
    "void(float64[:,::1],float64[::1],float64[:,::1],boolean[::1],float64[::1],float64,float64[::1])",
)
def exponents(logarithm: Any, highest: Any, weight: Any, alike: Any, remaining: Any, share: float, chosen: Any) -> None:
    """Write the exponents (trials,) of `quietfix.systems.filters.particle.tempering.next_exponent`, which see.

    `highest` (trials,) is the largest of each trial's logarithms; weights are not read where they are `alike`.
    """
    for t in range(logarithm.shape[0]):
        row, own = logarithm[t], weight[t]
        whole = _share(row, highest[t], remaining[t], own, alike[t])
        chosen[t] = remaining[t]
        if whole < share:
            variance = _variance(row, highest[t], own, alike[t])
            chosen[t] = _exponent(row, highest[t], own, alike[t], remaining[t], whole, share, variance)


@inlined
def _share(logarithm: Any, highest: float, exponent: float, weight: Any, alike: bool) -> float:
    first, second = powers(logarithm, highest, exponent, weight, alike)
    return first * first / (second * logarithm.shape[0] if alike else second)


@inlined
def _exponent(
    logarithm: Any,
    highest: float,
    weight: Any,
    alike: bool,
    remaining: float,
    whole: float,
    share: float,
    variance: float,
) -> float:
    """Find where the logarithm of the effective share over what is asked for changes its sign."""
    high, over_high = math.log(remaining), math.log(whole / share)
    low, over_low = high - _SMALLEST, -math.log(share)
    guess = 0.5 * math.log(-math.log(share) / max(variance, 1e-300))
    guess = min(max(guess, low + 1.0), high - 0.1)
    for _ in range(_EVALUATIONS):
        over = math.log(_share(logarithm, highest, math.exp(guess), weight, alike) / share)
        # Illinois: the end that stays counts half, so that both ends move
        if over >= 0.0:
            low, over_low, over_high = guess, over, 0.5 * over_high
        else:
            high, over_high, over_low = guess, over, 0.5 * over_low
        guess = low + (high - low) * over_low / max(over_low - over_high, 1e-300)
    return math.exp(low)


@summing
def _variance(logarithm: Any, highest: float, weight: Any, alike: bool) -> float:
    """Return the variance of the logarithms; -inf, which a particle may have, counts as far below."""
    count = logarithm.shape[0]
    first = second = 0.0
    for j in range(count):
        value = logarithm[j] - highest
        value = value if value > -1e12 else -1e12
        own = 1.0 / count if alike else weight[j]
        first += own * value
        second += own * value * value
    return second - first * first
