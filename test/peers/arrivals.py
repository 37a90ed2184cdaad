"""Stamps of arrival on a busy machine, made from the times at which samples were sent."""

import numpy as np


def arrival_stamps(times, kind, seed=0):
    """Return stamps (N,) [s], ascending, of samples sent at times (N,).

    kind: "bursts", 20 messages within 1 ms after silence; "stalls", an executor that stops for 20 to 150 ms each 0.3 s
    on average, with delays of 0.2 ms otherwise; "delays", of an exponential distribution with half a step as mean;
    "two_sided", early and late by 0.3 steps.
    """
    rng = np.random.default_rng(seed)
    step = np.median(np.diff(times))
    if kind == "bursts":
        cycle = 20 * step
        start = np.floor(times / cycle) * cycle
        return start + cycle + (times - start) / cycle * 1e-3
    if kind == "delays":
        return np.maximum.accumulate(times + rng.exponential(0.5 * step, len(times)))
    if kind == "two_sided":
        return np.sort(times + 0.3 * step * rng.normal(size=len(times)))
    assert kind == "stalls"
    stamps = times + rng.exponential(2e-4, len(times))
    stall = 0.0
    while stall < times[-1]:
        stall += rng.exponential(0.3)
        end = stall + rng.uniform(0.02, 0.15)
        waiting = (stamps > stall) & (stamps < end)
        stamps[waiting] = end + 2e-5 * np.arange(waiting.sum())
        stall = end
    return np.maximum.accumulate(stamps + 1e-9 * np.arange(len(stamps)))
