"""Judgement of what an observer has recorded around a fault: whether efforts were safe, and when they came back."""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from nodes.faults.bench import DAMPED, LED, LIMITS, is_near
from nodes.faults.waiting import Waiting
from peers.effort_observer import COMMAND, EFFORT, STATE

TIMEOUT, RAMP = 20_000_000, 100_000_000  # [ns] state_timeout and ramp_time by default
STANDSTILL = 1_000_000_000  # [ns] without states, after which zeros are sent though the simulated time stands still
SLACK = 10_000_000  # [ns] a period of the watchdog, and the way to the observer on a machine that does other things
RECOVERY = 1_000_000_000  # [ns]
LAST = np.iinfo(np.int64).max


@dataclass(frozen=True)
class Round:
    """What was observed around one fault.

    Attributes
    ----------
    fault : Fault
    records : array of RECORD
    began, ended : times [ns] of the fault by the clock of the machine.
    waiting : Waiting, when a busy machine had no processor for the node and for the observer.
    is_led : whether the efforts lead to the reference in the end.
    """

    fault: object
    records: np.ndarray
    began: int
    ended: int
    waiting: Waiting
    is_led: bool

    def of(self, kind):
        """Records of a kind."""
        return self.records[self.records["kind"] == kind]

    def slack(self, first, last):
        """How late [ns] something may come at a time [ns] that was begun at another one."""
        return SLACK + self.waiting.between(first, last)


@dataclass
class Judgement:
    """Figures of a round, times in ms, nan where there is none, and the violations of invariants."""

    excess: float = np.nan
    oldest: float = np.nan
    to_zero: float = np.nan
    recovery: float = np.nan
    busy: float = 0.0  # how much of these is more than what would be allowed on a machine that is not busy
    in_flight: int = 0
    violations: list[str] = field(default_factory=list)

    def require(self, holds, text):
        """Note a violation if an invariant does not hold."""
        if not holds:
            self.violations.append(text)

    def require_by(self, late, slack, text):
        """Note a violation if something is later [ns] than a slack [ns], and what a busy machine accounts for."""
        self.busy = max(self.busy, (late - SLACK) * 1e-6)
        self.require(late <= slack, f"{text} {late * 1e-6:.1f} ms late")


def unsettled(records, reason):
    """The Judgement of a round that ended early, because efforts are not those that are expected."""
    judgement = Judgement(violations=[reason])
    check_values(records, judgement)
    return judgement


def judge(observed):
    """The Judgement of a Round."""
    judgement = Judgement()
    check_values(observed.records, judgement)
    check_ages(observed, judgement)
    check_zeros(observed, judgement)
    check_outcome(observed, judgement)
    if observed.fault.node == "stands":
        check_standstill(observed, judgement)
    if observed.fault.node == "dies":
        check_new_process(observed, judgement)
    check_recovery(observed, judgement)
    return judgement


def check_values(records, judgement):
    """Efforts are finite and within limits."""
    efforts = records["efforts"][records["kind"] != STATE]
    judgement.require(np.isfinite(efforts).all(), "efforts are not finite")
    judgement.excess = np.max(np.abs(efforts) - LIMITS, initial=-np.inf)
    text = f"efforts are {judgement.excess:.3g} beyond their limits"
    judgement.require(judgement.excess <= 0 or np.isnan(judgement.excess), text)


def ages(observed, efforts):
    """Ages [ns] of the states that efforts answer, when they were received; 0 for efforts that answer none.

    By their stamps, or in simulated time by those that a state has had: since this state was received.
    """
    active = efforts["efforts"].any(axis=1)
    if not observed.fault.simulated:
        return np.where(active, efforts["received"] - efforts["stamp"], 0)
    states = observed.of(STATE)
    order = np.argsort(states["stamp"], kind="stable")
    stamps = states["stamp"][order]
    index = np.searchsorted(stamps, efforts["stamp"], side="right") - 1
    answers = active & (index >= 0) & (stamps[index] == efforts["stamp"])
    return np.where(answers, efforts["received"] - states["received"][order][index], 0)


def check_ages(observed, judgement):
    """No effort answers a state older than state_timeout.

    One message that the node had handed over to the middleware when it was stopped may leave when it goes on.
    """
    efforts = observed.of(EFFORT)
    age, received = ages(observed, efforts), efforts["received"]
    late = age - TIMEOUT - observed.slack(received - age, received)
    if observed.fault.node == "stands":
        zeros = first(efforts, observed.ended, is_active=False)
        in_flight = (late > 0) & (received >= observed.ended) & (received < zeros)
        if in_flight.sum() == 1:
            judgement.in_flight = 1
            age, late = age[~in_flight], late[~in_flight]
    judgement.oldest = age.max(initial=0) * 1e-6
    judgement.busy = max(judgement.busy, judgement.oldest - (TIMEOUT + SLACK) * 1e-6)
    oldest = age[late > 0].max(initial=0) * 1e-6
    judgement.require(not oldest, f"{(late > 0).sum()} efforts answer old states, up to {oldest:.1f} ms")


def usable_states(observed):
    """Times [ns] at which states came that efforts may answer."""
    states = observed.of(STATE)
    if observed.fault.simulated:
        return states["received"]
    return states["received"][np.abs(states["received"] - states["stamp"]) <= TIMEOUT]


def check_zeros(observed, judgement):
    """Efforts are zero within state_timeout and ramp_time after the last state, until the next one comes."""
    usable = usable_states(observed)
    due = STANDSTILL if observed.fault.simulated else TIMEOUT + RAMP
    gaps = [
        (last, last + due, following)
        for last, following in pairwise(usable)
        if following > last + due + SLACK and following > last + due + observed.slack(last, following)
    ]
    if observed.fault.zeros_after is not None:
        began = observed.began
        gaps.append((began, began + round(observed.fault.zeros_after * 1e9) + TIMEOUT, observed.ended))
    commands = observed.of(COMMAND)
    active = commands["efforts"].any(axis=1)
    for last, due, following in gaps:
        inside = (commands["received"] > last) & (commands["received"] < following)
        last_active = commands["received"][inside & active].max(initial=last)
        if observed.fault.node == "dies" or not observed.fault.is_observed:
            judgement.require_by(last_active - due, observed.slack(last, last_active), "efforts without states come")
        elif observed.fault.node == "runs":  # for one that stands still see check_standstill
            zero = max(last_active, commands["received"][inside & ~active].min(initial=following))
            judgement.to_zero = np.fmax(judgement.to_zero, (zero - last) * 1e-6)
            judgement.require_by(zero - due, observed.slack(last, zero), "zeros come")


def first(records, since, is_active):
    """Time [ns] at which the first efforts that are not zero, or are zero, come at a time or later."""
    matching = records["efforts"].any(axis=1) == is_active
    return records["received"][matching & (records["received"] >= since)].min(initial=LAST)


def check_outcome(observed, judgement):
    """Zeros come or do not, as the fault has it, and the reference is dropped where they come, and there only."""
    commands = observed.of(COMMAND)
    has_zeros = not commands["efforts"].any(axis=1).all()
    if observed.fault.outcome == "undisturbed":
        zeros = first(commands, observed.began, is_active=False)
        is_busy = observed.waiting.between(zeros - TIMEOUT - RAMP, zeros) > TIMEOUT
        judgement.require(not has_zeros or is_busy, "efforts are disturbed")
    if observed.fault.outcome == "zeros":
        judgement.require(has_zeros or observed.fault.durations[0] < 0.2, "there are no zeros")
    if observed.fault.keeps_reference and observed.fault.node == "runs" and not observed.fault.latches:
        reference = "kept" if observed.is_led else "dropped"
        zeros = "with zeros" if has_zeros else "without zeros"
        judgement.require(has_zeros != observed.is_led, f"the reference is {reference} {zeros}")


def check_standstill(observed, judgement):
    """A node that stood still sends zeros first, but for one message that it had handed over to the middleware."""
    commands = observed.of(COMMAND)
    after = commands[commands["received"] >= observed.ended]
    zeros = first(after, observed.ended, is_active=False)
    late = zeros - observed.ended
    judgement.to_zero = late * 1e-6
    judgement.require_by(late, observed.slack(observed.ended, zeros), "zeros of a node that stood still come")
    early = (after["received"] < zeros).sum()
    judgement.require(early <= 1, f"{early} efforts come before zeros")
    judgement.require(not observed.is_led, "the reference is kept")


def of_new_process(observed):
    """Commands of a process that was started in place of one that was killed: those after the longest silence."""
    commands = observed.of(COMMAND)
    return commands[1 + np.diff(commands["received"]).argmax() :]


def check_new_process(observed, judgement):
    """The efforts of a new process begin at zero."""
    new = of_new_process(observed)
    began = new["received"].min(initial=LAST)
    share = np.abs(new["efforts"] / np.maximum(np.abs(DAMPED), 1e-9))[:, 3]  # of the ramp
    ramp = np.clip((new["received"] - began + observed.slack(began - RAMP, began)) / RAMP, 0, 1)
    judgement.require((share <= ramp + 1e-6).all(), "efforts of a new process do not begin at zero")


def check_recovery(observed, judgement):
    """Efforts are as before within a second after the fault, and after the first state and message of the node."""
    commands = observed.of(COMMAND)
    usable = usable_states(observed)
    since = usable[usable >= observed.ended].min(initial=LAST)
    if observed.fault.node == "dies":
        since = max(since, of_new_process(observed)["received"].min(initial=LAST))
    full = is_near(commands["efforts"], DAMPED) | is_near(commands["efforts"], LED)
    back = commands["received"][full & (commands["received"] >= since)].min(initial=LAST)
    judgement.require(back < LAST, "efforts do not come back")
    if back < LAST:
        judgement.recovery = (back - since) * 1e-6
        judgement.require_by(back - since - RECOVERY, observed.slack(since, back), "efforts come back")
