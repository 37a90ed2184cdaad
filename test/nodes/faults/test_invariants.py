"""The judgement of faults: recordings that are as they should be, and those that violate one invariant."""

import numpy as np
import pytest
from nodes.faults.bench import DAMPED, LED, LIMITS
from nodes.faults.faults import Fault
from nodes.faults.invariants import RAMP, TIMEOUT, Round, judge
from nodes.faults.waiting import Waiting
from peers.effort_observer import COMMAND, EFFORT, RECORD, STATE

MS = 1_000_000  # [ns]
EPOCH = 1_700_000_000_000 * MS


def record(kind, received, stamp=0, efforts=np.nan):
    """A record; times in ms since EPOCH."""
    row = np.zeros(1, dtype=RECORD)
    row["kind"], row["received"], row["stamp"] = kind, EPOCH + round(received * MS), EPOCH + round(stamp * MS)
    row["efforts"] = efforts
    return row


def share(ms, silence):
    """The part of the efforts that is sent at a time [ms], for a silence (first, last) [ms] of the states."""
    first, last = silence
    if ms < first + TIMEOUT / MS:
        return 1.0
    if ms < last:
        return max(0.0, 1 - (ms - first - TIMEOUT / MS) / (RAMP / MS))
    return min(1.0, (ms - last) / (RAMP / MS))


def recorded(silence=(300, 600), share=share, end=1000):
    """Records of states and efforts, one a millisecond, of which states are missing for a time."""
    rows = []
    for ms in range(end):
        is_silent = silence[0] <= ms < silence[1]
        if not is_silent:
            rows.append(record(STATE, ms, ms - 0.2))
        efforts = share(ms, silence) * (LED if ms < silence[0] + 120 else DAMPED)
        rows.append(record(COMMAND, ms + 0.4, efforts=efforts))
        rows.append(record(EFFORT, ms + 0.5, ms - 0.2, efforts))
    return np.concatenate(rows)


def violations(records, waiting=0.0, is_led=False, silence=(300, 600), **outcome):
    fault = Fault("test", **outcome)
    began, ended = (EPOCH + ms * MS for ms in silence)
    return judge(Round(fault, records, began, ended, Waiting.constant(waiting), is_led)).violations


def test_safe_efforts_violate_nothing():
    assert violations(recorded(), outcome="zeros") == []
    calm = recorded(silence=(500, 510))
    assert violations(calm, is_led=True, silence=(500, 510), outcome="undisturbed") == []


def test_figures_are_measured():
    fault = Fault("test", outcome="zeros")
    judgement = judge(Round(fault, recorded(), EPOCH + 300 * MS, EPOCH + 600 * MS, Waiting.constant(0.0), False))
    assert judgement.oldest == pytest.approx(0.7, abs=1e-3)
    assert judgement.to_zero == pytest.approx(121.4, abs=1e-3)
    assert judgement.recovery == pytest.approx(100.4, abs=0.2)
    assert judgement.excess == 0.0  # LIMITS are reached


def test_a_busy_machine_accounts_for_delays():
    late = recorded(share=lambda ms, silence: share(ms - 30 if ms < silence[1] else ms, silence))
    assert "late" in " ".join(violations(late))
    assert violations(late, waiting=0.2) == []


def test_waiting_is_that_of_the_sender_and_of_one_receiving_thread_within_the_samples_around():
    waiting = Waiting(np.array([0, 10, 20, 30]), np.array([0, 1, 1, 4]), np.array([[0, 0], [0, 2], [5, 2], [5, 2]]))
    assert waiting.between(12, 18) == 0 + 5
    assert waiting.between(np.array([5, 20, -5]), np.array([15, 25, 99])).tolist() == [1 + 5, 3, 4 + 5]


def broken(change):
    """Records in which the efforts, or the stamps, of one kind at some times are others."""
    records = recorded()
    ms = (records["received"] - EPOCH) / MS
    change(records, ms)
    return records


def set_efforts(at, value, kind=COMMAND):
    """A change of the efforts at a time [ms]."""

    def change(records, ms):
        records["efforts"][(records["kind"] == kind) & (at <= ms) & (ms < at + 1)] = value

    return change


def make_old(records, ms):
    records["stamp"][(records["kind"] == EFFORT) & (np.abs(ms - 200.5) < 0.1)] -= 50 * MS


BROKEN = {
    "nan": (set_efforts(200, np.nan), "not finite"),
    "infinite, by name": (set_efforts(200, np.inf, EFFORT), "not finite"),
    "too large": (set_efforts(200, 1.01 * LIMITS), "beyond their limits"),
    "negative": (set_efforts(200, -1.01 * LIMITS, EFFORT), "beyond their limits"),
    "an old state": (make_old, "answer old states, up to 50.7 ms"),
    "no zeros": (set_efforts(550, 0.01 * DAMPED), "zeros come 131.4 ms late"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_a_single_unsafe_message_violates_an_invariant(case):
    change, text = BROKEN[case]
    assert text in violations(broken(change))[0]


def test_zeros_are_not_required_where_they_cannot_be_observed():
    records = recorded()
    ms = (records["received"] - EPOCH) / MS
    is_received = (ms < 300) | (ms > 599)
    assert violations(records[is_received], is_observed=False) == []
    assert "zeros come" in violations(records[is_received])[0]
    assert "efforts without states come" in violations(broken(set_efforts(550, DAMPED)), is_observed=False)[0]


def test_outcomes_are_required():
    assert "efforts are disturbed" in violations(recorded(), outcome="undisturbed")
    held = recorded(silence=(500, 510))
    long = {"outcome": "zeros", "durations": (0.3, 1.0)}
    assert "there are no zeros" in violations(held, silence=(500, 510), is_led=True, **long)
    assert "the reference is kept with zeros" in violations(recorded(), is_led=True)
    assert "the reference is dropped without zeros" in violations(held, silence=(500, 510))


def test_efforts_that_come_back_late_or_never_violate_an_invariant():
    slow = recorded(share=lambda ms, silence: share(ms, silence) if ms < 600 else min(1, (ms - 600) / 1200), end=2000)
    assert violations(slow) == ["efforts come back 200.4 ms late"]
    weak = recorded(share=lambda ms, silence: min(0.99, share(ms, silence)))
    assert "efforts do not come back" in violations(weak)


def stood_still(early):
    """Records of a node that stood still from 300 to 600 ms, with some efforts before zeros."""
    records = recorded(silence=(600, 601), share=lambda ms, _: 0.0 if 600 + early <= ms < 610 else 1.0)
    ms = (records["received"] - EPOCH) / MS
    records["efforts"][(ms > 610) & (records["kind"] != STATE)] = DAMPED
    return records[(records["kind"] == STATE) | (ms < 300) | (ms >= 600)]


@pytest.mark.parametrize(("early", "expected"), [(0, []), (1, []), (2, ["2 efforts come before zeros"])])
def test_a_node_that_stood_still_sends_zeros_first(early, expected):
    assert violations(stood_still(early), node="stands", outcome="zeros") == expected


def test_a_new_process_begins_at_zero():
    records = recorded(silence=(300, 300), share=lambda ms, _: min(1.0, (ms - 600) / 100) if ms >= 600 else 1.0)
    ms = (records["received"] - EPOCH) / MS
    sent = records[(records["kind"] == STATE) | (ms < 300) | (ms >= 600)]
    assert violations(sent, node="dies") == []
    sent["efforts"][sent["kind"] != STATE] = DAMPED
    assert violations(sent, node="dies") == ["efforts of a new process do not begin at zero"]
