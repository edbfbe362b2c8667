"""Earth-fixed axes into latitude, longitude, height and north, east, down."""

from __future__ import annotations

import numpy as np

from levelhead.logs.ecef import llh_from_ecef, ned_from_ecef

A, B = 6378137.0, 6356752.314245
"""WGS84's half axes, m."""


def test_places_whose_coordinates_are_known_by_heart() -> None:
    # On the equator at Greenwich, 90 degrees east of it 100 m up, at the north pole 10 m down.
    llh = llh_from_ecef(np.array([[A, 0.0, 0.0], [0.0, A + 100.0, 0.0], [0.0, 0.0, B - 10.0]]))
    np.testing.assert_allclose(llh[:, 0], [0.0, 0.0, np.pi / 2.0], atol=1e-12)
    np.testing.assert_allclose(llh[:2, 1], [0.0, np.pi / 2.0], atol=1e-12)
    np.testing.assert_allclose(llh[:, 2], [0.0, 100.0, -10.0], atol=1e-6)  # six decimals of B


def test_what_is_no_place_is_none() -> None:
    llh = llh_from_ecef(np.array([[0.0, 0.0, 0.0], [A / 1000.0, 0.0, 0.0], [np.nan, 0.0, A], [1e300, 1e300, 0.0]]))
    assert np.isnan(llh).all()
    assert llh_from_ecef(np.empty((0, 3))).shape == (0, 3)


def test_velocities_along_the_axes_of_the_earth() -> None:
    # On the equator at 90 degrees east: the Earth's y axis points up, its z axis north, its x axis west.
    place = np.array([[0.0, np.pi / 2.0, 0.0]])
    ned = ned_from_ecef(np.array([[1.0, 2.0, 3.0]]), place)
    np.testing.assert_allclose(ned, [[3.0, -1.0, -2.0]], atol=1e-15)  # rounding
    assert ned_from_ecef(np.empty((0, 3)), np.empty((0, 3))).shape == (0, 3)
    assert np.isnan(ned_from_ecef(np.ones((1, 3)), np.full((1, 3), np.nan))).all()


def test_a_velocity_is_the_step_of_the_position() -> None:
    """By differences of positions, without the formula of the rotation."""
    start = np.array([-3961877.186, 3348960.851, 3698236.993])
    velocity = np.array([3.0, -7.0, 2.0])
    before, after = (llh_from_ecef((start + s * velocity)[np.newaxis])[0] for s in (-0.5, 0.5))
    middle = llh_from_ecef(start[np.newaxis])
    latitude, _, height = middle[0]
    e2 = 1.0 - (B / A) ** 2
    w = np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
    north, east = A * (1.0 - e2) / w**3 + height, (A / w + height) * np.cos(latitude)
    step = (after - before) * [north, east, -1.0]
    # Positions of 4e6 m as float64 resolve 5e-10 m; the Earth bends 4 m away by 1e-6 of a metre.
    np.testing.assert_allclose(ned_from_ecef(velocity[np.newaxis], middle)[0], step, atol=2e-6)
