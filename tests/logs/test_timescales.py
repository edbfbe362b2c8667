"""GPS time and UTC against dates that everybody can look up."""

from __future__ import annotations

import datetime

import pytest

from levelhead.errors import LogError
from levelhead.logs.timescales import between


def seconds(text: str) -> float:
    return datetime.datetime.fromisoformat(text).replace(tzinfo=datetime.UTC).timestamp()


@pytest.mark.parametrize(
    ("utc", "ahead"),
    [
        ("1980-01-06T00:00:00", 0.0),
        ("1999-01-01T00:00:00", 13.0),
        ("2016-12-31T23:59:59", 17.0),
        ("2017-01-01T00:00:00", 18.0),
        ("2026-06-01T12:00:00", 18.0),
    ],
)
def test_gps_time_is_ahead_by_the_leap_seconds_since_1980(utc: str, ahead: float) -> None:
    assert between("UTC", "GPST", seconds(utc)) == ahead
    assert between("GPST", "UTC", seconds(utc) + ahead) == -ahead


def test_japan_is_nine_hours_ahead() -> None:
    assert between("UTC", "JST", seconds("2026-06-01T12:00:00")) == 9 * 3600.0


def test_another_scale_is_refused() -> None:
    with pytest.raises(LogError, match="'GLONASST' is not known; use GPST, UTC or JST"):
        between("GLONASST", "UTC", 0.0)
