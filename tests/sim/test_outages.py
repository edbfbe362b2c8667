"""GNSS goes away for a while and comes back; nothing else changes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import levelhead as lh
from levelhead.errors import UsageError
from levelhead.logs.log import Log
from levelhead.sim import Outage, outage_windows, without_gnss


@pytest.fixture(scope="module")
def log() -> Log:
    """A minute with everything a log can have."""
    return lh.simulate("field", seed=1, duration=60.0, sensors=lh.SensorModel(wheel_speed=True))[0]


def test_the_epochs_in_the_windows_are_gone(log: Log) -> None:
    cut = without_gnss(log, [(10.0, 5.0), (40.0, 0.05)])
    # From 10.0 to 14.9, and the one at 40.0: both starts are included, 15.0 is not.
    gone = ~np.isin(log.gnss_time, cut.gnss_time)
    np.testing.assert_array_equal(np.flatnonzero(gone), [*range(100, 150), 400])
    for name in ("velocity_ned", "velocity_std", "position_llh", "position_std"):
        np.testing.assert_array_equal(getattr(cut, name), getattr(log, name)[~gone])
    for name in ("time", "gyro", "accel", "wheel_speed"):
        np.testing.assert_array_equal(getattr(cut, name), getattr(log, name))


def test_the_log_remembers_its_outages(log: Log) -> None:
    cut = without_gnss(without_gnss(log, [(10.0, 5.0)]), [Outage(30.0, 2.0)])
    assert cut.meta["gnss_outages"] == ((10.0, 5.0), (30.0, 2.0))
    assert cut.meta["source"] == log.meta["source"]
    assert "gnss_outages" not in log.meta


def test_a_log_with_velocities_only_can_lose_them(log: Log) -> None:
    bare = Log(time=log.time, gyro=log.gyro, accel=log.accel, gnss_time=log.gnss_time, velocity_ned=log.velocity_ned)
    cut = without_gnss(bare, [(0.0, 59.0)])
    assert cut.gnss_time[0] == 59.0
    assert cut.position_llh is None
    assert cut.velocity_std is None


def test_no_window_leaves_the_log_as_it_is(log: Log) -> None:
    assert without_gnss(log, []) is log


def test_outages_may_overlap_and_reach_over_the_end(log: Log) -> None:
    cut = without_gnss(log, [(50.0, 5.0), (52.0, 100.0)])
    assert cut.gnss_time[-1] < 50.0


def test_windows_are_spread_evenly() -> None:
    windows = outage_windows(100.0, 700.0, 60.0, count=4)
    # 600 s less 240 s are 360 s, in five parts of 72 s.
    assert [w.start for w in windows] == [172.0, 304.0, 436.0, 568.0]
    assert {w.length for w in windows} == {60.0}
    assert windows[-1].stop + 72.0 == 700.0


def test_windows_at_a_distance_end_before_the_end() -> None:
    assert outage_windows(0.0, 100.0, 10.0, every=30.0) == ((0.0, 10.0), (30.0, 10.0), (60.0, 10.0), (90.0, 10.0))
    assert outage_windows(0.0, 99.0, 10.0, every=30.0)[-1] == (60.0, 10.0)
    # 0.1 * 3 is more than 0.3 in floating point; the last window is not lost to it.
    assert len(outage_windows(0.0, 0.4, 0.1, every=0.1 + 1e-12)) == 4


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"start": 0.0, "stop": 10.0, "length": 20.0, "count": 1}, "No outage of 20.0 s fits"),
        ({"start": 0.0, "stop": 10.0, "length": 0.0, "count": 1}, "No outage of 0.0 s"),
        ({"start": 0.0, "stop": math.nan, "length": 1.0, "count": 1}, "and nan s"),
        ({"start": 0.0, "stop": 10.0, "length": 2.0}, "either count"),
        ({"start": 0.0, "stop": 10.0, "length": 2.0, "count": 1, "every": 3.0}, "either count"),
        ({"start": 0.0, "stop": 10.0, "length": 2.0, "count": 5}, "from 1 to 4"),
        ({"start": 0.0, "stop": 10.0, "length": 2.0, "count": 0}, "from 1 to 4"),
        ({"start": 0.0, "stop": 10.0, "length": 2.0, "every": 2.0}, "leaves no GNSS"),
        ({"start": 0.0, "stop": 10.0, "length": 2.0, "every": math.nan}, "leaves no GNSS"),
    ],
)
def test_windows_that_do_not_fit_are_refused(arguments: dict[str, Any], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        outage_windows(**arguments)


@pytest.mark.parametrize(
    ("window", "words"),
    [
        ((70.0, 5.0), "not in the log, which runs from 0 to 59.99 s"),
        ((-5.0, 5.0), "not in the log"),
        ((10.0, 0.0), "is none"),
        ((10.0, -1.0), "is none"),
        ((math.nan, 1.0), "is none"),
    ],
)
def test_a_window_outside_the_log_is_a_mistake(log: Log, window: tuple[float, float], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        without_gnss(log, [window])
