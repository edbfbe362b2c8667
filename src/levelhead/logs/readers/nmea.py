"""NMEA 0183, GNSS only: positions from GGA, their sigmas from GST, velocities from RMC, else from VTG.

The velocity is horizontal only and rounded to the digits of the sentence. Stamps are UTC; the date comes from RMC or
ZDA. What stands before the ``$`` of a line, such as a computer's clock, is passed over, and tells the date where no
sentence does.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.earth import steps_ned
from levelhead.errors import LogError
from levelhead.events import Event
from levelhead.logs.datum import ELLIPSOIDAL, MEAN_SEA_LEVEL, WGS84, declared
from levelhead.logs.pieces import GnssData, Pieces, none_if_absent
from levelhead.logs.readers.base import Reader, Source
from levelhead.logs.readers.nmea_sentences import DAY_S, Sentences, checksum, scan
from levelhead.logs.readers.receivers import dropped, known_std, unmeasured_vertical_std, velocity_of
from levelhead.logs.timescales import UTC, continued

Rows = NDArray[np.intp]

_SNIFFED: Final = re.compile(rb"\$([A-Z]{2}[A-Z]{3},[^$*\n]*)\*([0-9A-Fa-f]{2})")
_NO_FIX: Final = (0.0, 6.0, 7.0)
"""Qualities of GGA that are no GNSS fix: none, dead reckoning, entered by hand."""
_SLOW: Final = 0.5
"""Below this a receiver may tell a speed and no course, m/s."""
_DATUMS: Final = {"W84": WGS84, "W72": "WGS72", "S85": "SGS85", "P90": "PZ90"}


def sniff(_path: Path, head: bytes) -> bool:
    """Return whether half of the bytes or more are sentences, and one that is read has the right checksum."""
    found = list(_SNIFFED.finditer(head))
    if 2 * sum(len(m.group()) for m in found) < len(head):
        return False
    read = (m for m in found if m.group(1)[2:5] in (b"GGA", b"RMC", b"VTG"))
    return any(checksum(m.group(1)) == int(m.group(2), 16) for m in read)


def read(source: Source) -> Pieces:
    """Read an NMEA file; times become seconds since 1970, UTC.

    Raises
    ------
    LogError
        When no sentence tells a fix with its time, or DTM declares a datum that is not within a metre of WGS84.
    """
    name = source.path.name
    found = scan(source.path)
    epochs = _Epochs(found)
    if not epochs.time.size:
        raise LogError(
            f"{name}: of {found.sentences} NMEA sentences with the right checksum no GGA or RMC has a time; record GGA "
            "and RMC."
        )
    fixed = epochs.fixed()
    events = [*dropped(int((~fixed).sum()), "NMEA epochs without a GNSS fix")]
    if not fixed.any():
        raise LogError(f"{name}: none of {fixed.size} epochs has a GNSS fix.")
    events += dropped(found.odd, "lines that are no NMEA sentences")
    events += dropped(epochs.repeated, "sentences that repeat the time of others of their kind")
    ned, ned_std = epochs.velocities()
    moving = int(np.isfinite(ned[fixed]).all(axis=1).sum())
    if moving:
        events.append(Event(code="I_VELOCITY_2D", count=moving))
    llh, height = epochs.positions()
    gnss = GnssData(
        time=epochs.time[fixed],
        velocity_ned=none_if_absent(ned[fixed]),
        velocity_std=ned_std[fixed] if moving else None,
        position_llh=none_if_absent(llh[fixed]),
        position_std=none_if_absent(np.where(np.isnan(llh), np.nan, epochs.position_std())[fixed]),
        time_scale=UTC if epochs.dated else None,
    )
    if gnss.velocity_ned is None and gnss.position_llh is None:
        raise LogError(
            f"{name}: no epoch has a position with its altitude (GGA) or a velocity (RMC, VTG); record them."
        )
    datum = None if found.datum is None else _DATUMS.get(found.datum, found.datum)
    return Pieces(
        gnss=gnss,
        left_out=found.left_out,
        damaged=_damage(name, found),
        meta=declared(name, datum=datum, height=height if gnss.position_llh is not None else None),
        events=tuple(events),
        undeclared=() if epochs.dated and epochs.sure else ("clock",),
    )


def _damage(name: str, found: Sentences) -> str:
    if not found.damaged:
        return ""
    return (
        f"{name}: {found.damaged} lines are no NMEA sentences with the right checksum and fields; the first is line "
        f"{found.first_damaged}."
    )


class _Epochs:
    """Sentences of the same time, in the order in which the times first appear.

    Attributes
    ----------
    time : (n,) float64
        Seconds since 1970, UTC; since the first midnight where no date is known.
    dated : bool
        Whether a date is known.
    sure : bool
        Whether it is sure to which epochs the velocities belong.
    repeated : int
        Sentences that came after others of the same kind and time, and were not used.
    """

    def __init__(self, found: Sentences) -> None:
        kinds = {kind: found.of(kind) for kind in (b"GGA", b"RMC", b"GST", b"ZDA")}
        kinds = {kind: rows[np.isfinite(rows[:, 1])] for kind, rows in kinds.items()}
        days = [r[:, 2] if kind in (b"RMC", b"ZDA") else np.full(len(r), np.nan) for kind, r in kinds.items()]
        columns = [[r[:, 0] for r in kinds.values()], [r[:, 1] for r in kinds.values()], days]
        line, clock, day = (np.concatenate(c) for c in columns)
        order = np.argsort(line, kind="stable")
        line, clock, day = line[order], clock[order], day[order]
        if not np.isfinite(day).any():
            day = _days_of_host(found.host_days, line, clock)
        self.dated = bool(np.isfinite(day).any())
        time = continued(clock, DAY_S * day, np.isfinite(day), DAY_S)
        self._line, self._timed = line, time
        place = {kind: np.searchsorted(line, rows[:, 0]) for kind, rows in kinds.items()}
        made = np.sort(np.concatenate((place[b"GGA"], place[b"RMC"])))
        # Receivers write at most a thousandth of a second; sentences of one epoch say the same.
        _, first = np.unique(np.round(1e3 * time[made]).astype(np.int64), return_index=True)
        self.time = time[made][np.sort(first)]
        self.repeated = 0
        self._gga = self._on_epochs(kinds[b"GGA"][:, 2:], time[place[b"GGA"]])
        self._rmc = self._on_epochs(kinds[b"RMC"][:, 3:], time[place[b"RMC"]])
        self._gst = self._on_epochs(kinds[b"GST"][:, 2:], time[place[b"GST"]])
        self.sure = True
        self._vtg = self._velocities_of_vtg(found.of(b"VTG")) if np.isnan(self._rmc[:, 1]).all() else None

    def _on_epochs(self, values: FloatArray, time: FloatArray) -> FloatArray:
        """Return rows of sentences at the epochs of the same time, the first of each; NaN where there is none."""
        rows = np.full((self.time.size, values.shape[1]), np.nan)
        if self.time.size and time.size:
            order = np.argsort(self.time, kind="stable")
            near = np.clip(np.searchsorted(self.time[order], time - 5e-4), 0, order.size - 1)
            at = order[near]
            same = np.flatnonzero(np.abs(self.time[at] - time) < 5e-4)[::-1]
            rows[at[same]] = values[same]
            self.repeated += same.size - np.unique(at[same]).size
        return rows

    def fixed(self) -> NDArray[np.bool_]:
        """Return which epochs have a fix by all of their sentences."""
        quality, valid = self._gga[:, 4], self._rmc[:, 0]
        good: NDArray[np.bool_] = ~np.isin(quality, _NO_FIX) & (valid != 0.0) & ~(np.isnan(quality) & np.isnan(valid))
        return good

    def positions(self) -> tuple[FloatArray, str]:
        """Return latitude, longitude (rad) and height (m), and what the heights count from."""
        lat, lon, altitude, separation, _ = self._gga.T
        placed = np.isfinite(altitude)
        whole = bool(placed.any()) and bool(np.isfinite(separation[placed]).all())
        llh = np.column_stack((lat, lon, altitude + separation if whole else altitude))
        llh[np.isnan(llh).any(axis=1)] = np.nan
        return llh, ELLIPSOIDAL if whole else MEAN_SEA_LEVEL

    def position_std(self) -> FloatArray:
        """Return the sigmas of latitude, longitude and height, m; NaN where none is told."""
        return known_std(self._gst)

    def velocities(self) -> tuple[FloatArray, FloatArray]:
        """Return velocities NED, the vertical one zero, and their sigmas, of which only the vertical one is known."""
        speed, course = (self._rmc[:, 1:3] if self._vtg is None else self._vtg).T
        # At a walk or less the course may be empty: the velocity is then zero within the speed.
        still = np.isnan(course) & (speed < _SLOW)
        ned = velocity_of(speed, course)
        ned[still] = 0.0
        ned[np.isnan(ned[:, 0])] = np.nan
        std = np.full(ned.shape, np.nan)
        std[:, 2] = unmeasured_vertical_std(speed)
        std[still, :2] = np.maximum(speed[still], 0.05)[:, np.newaxis]
        return ned, std

    def _velocities_of_vtg(self, vtg: FloatArray) -> FloatArray | None:
        """Return speeds and courses at the epochs; VTG has no time and stands before or after those that do."""
        if not len(vtg) or not self._line.size:
            return None
        after = np.searchsorted(self._line, vtg[:, 0])
        before = np.clip(after - 1, 0, self._line.size - 1)
        after = np.clip(after, 0, self._line.size - 1)
        counted = self.repeated
        ways = [self._on_epochs(vtg[:, 1:], self._timed[k]) for k in (before, after)]
        self.repeated = counted
        if (self._timed[before] == self._timed[after]).all():
            return ways[0]
        return ways[self._better(*ways)]

    def _better(self, first: FloatArray, second: FloatArray) -> int:
        """Return which of two ways to give velocities to epochs goes with the steps of the positions.

        Taken for the next epoch's, a velocity would be a whole epoch late. Where the positions do not tell, the first
        is taken, and `sure` is false.
        """
        llh, _ = self.positions()
        placed = np.flatnonzero(np.isfinite(llh).all(axis=1))
        errors = []
        for way in (first, second):
            ned = velocity_of(*way[placed].T)[:, :2]
            step_s = np.diff(self.time[placed])[:, np.newaxis]
            driven = steps_ned(llh[placed])[:, :2] - 0.5 * step_s * (ned[1:] + ned[:-1])
            errors.append((driven**2).sum(axis=1))
        told = np.isfinite(errors[0]) & np.isfinite(errors[1])
        worse = errors[0][told] - errors[1][told]
        # The mean of the differences must be beyond five of its own sigmas.
        self.sure = bool(worse.size > 10 and abs(worse.mean()) > 5.0 * worse.std() / np.sqrt(worse.size))
        return int(self.sure and worse.mean() > 0.0)


def _days_of_host(host: FloatArray, line: FloatArray, clock: FloatArray) -> FloatArray:
    """Return the days in UTC that a computer's clock tells of timed sentences, in whatever time zone it ran."""
    day = np.full(line.size, np.nan)
    if len(host) and line.size:
        near = np.clip(np.searchsorted(line, host[:, 0]), 0, line.size - 1)
        same = line[near] == host[:, 0]
        at = near[same]
        day[at] = np.round(host[same, 1] - clock[at] / DAY_S)
    return day


READER: Final = Reader(name="nmea", title="NMEA 0183", sniff=sniff, read=read)
