"""Latitude and gravity from a log's positions."""

from __future__ import annotations

import math

import numpy as np
import pytest

import levelhead as lh
from levelhead.earth import normal_gravity
from levelhead.estimators.place import at_place


def test_normal_gravity_is_that_of_wgs_84() -> None:
    # NIMA TR8350.2, table 3.4: at the equator and at the pole; the last digit given there.
    assert normal_gravity(0.0, 0.0) == pytest.approx(9.7803253359, abs=1e-10)
    assert normal_gravity(0.5 * math.pi, 0.0) == pytest.approx(9.8321849379, abs=1e-9)
    # The free-air gradient: 0.3086 mGal per metre.
    assert normal_gravity(0.8, 1000.0) - normal_gravity(0.8, 0.0) == pytest.approx(-3.086e-3, rel=1e-9)


def test_a_log_tells_where_it_was_driven() -> None:
    log, _ = lh.simulate("field", seed=1, duration=20.0)
    assert log.position_llh is not None
    params = at_place(lh.PhasorParams(), log)
    assert params.latitude is not None
    assert params.latitude == pytest.approx(float(np.median(log.position_llh[:, 0])))
    assert params.gravity == pytest.approx(normal_gravity(params.latitude, 60.0), abs=1e-4)
    # What the user says stands.
    assert at_place(lh.PhasorParams(latitude=0.1), log) == lh.PhasorParams(latitude=0.1)
    assert at_place(lh.PhasorParams(gravity=9.8), log).gravity == 9.8


def test_a_simulated_earth_that_stands_still_is_not_compensated() -> None:
    still, _ = lh.simulate("field", seed=1, duration=60.0)
    turning, _ = lh.simulate("field", seed=1, duration=60.0, earth_rotation=True)
    assert lh.estimate(still, "phasor").params["latitude"] is None
    assert lh.estimate(turning, "phasor").params["latitude"] is not None
