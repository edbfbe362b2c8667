"""The estimated path in a `result.parquet`, as a `Track`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.errors import LogError, UsageError
from levelhead.estimators.base import Status
from levelhead.logs.datum import DATUM_KEY, HEIGHT_KEY, declared
from levelhead.logs.readers.canonical_parquet import MAGIC
from levelhead.logs.tracks import Track

if TYPE_CHECKING:
    import pyarrow.parquet as pq

Point = Literal["imu", "reference"]

RESULT_KEY: Final = b"levelhead"
"""Table metadata of a result: JSON that may have ``epoch``, ``gnss_time_scale``, ``datum``, ``height`` and ``source``
of its log, at the top or under ``log``."""

_MARKS: Final = frozenset({"time", "status", "gyro_bias_x", "roll"})
_PLACE: Final = ("latitude", "longitude", "height")


def is_result(path: Path) -> bool:
    """Return whether a file is a `result.parquet` of `levelhead estimate`; what cannot be read is none."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        if not path.is_file():
            return False
        with path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                return False
        names = set(pq.read_schema(path).names)
    except (OSError, pa.ArrowException):
        return False
    return names >= _MARKS and "gyro_x" not in names


def result_track(path: Path, point: Point | None = None) -> Track:
    """Read the estimated path.

    Parameters
    ----------
    path : Path
        A file for which `is_result` holds.
    point : {"imu", "reference"}, optional
        Whose path; by default that of the reference point, where the result has one.

    Returns
    -------
    Track
        At the result's time stamps that have a position.

    Raises
    ------
    UsageError
        When the result has no reference point and one is asked for.
    LogError
        When it has no positions, or cannot be read or trusted.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            return _track(path.name, file, point)
    except (pa.ArrowException, OSError) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise LogError(f"{path.name}: the result cannot be read ({reason}); estimate or copy it again.") from error


def _track(name: str, file: pq.ParquetFile, point: Point | None) -> Track:
    names = set(file.schema_arrow.names)
    if not names.issuperset(_PLACE):
        raise LogError(f"{name} has no positions, because its log had none; there is no path to write.")
    has_reference = names.issuperset(f"reference_{column}" for column in _PLACE)
    if point == "reference" and not has_reference:
        raise UsageError(f"{name} was estimated without a reference point; leave out --point, or estimate with one.")
    use_reference = has_reference and point != "imu"
    prefix = "reference_" if use_reference else ""

    def read(*columns: str) -> FloatArray:
        table = file.read(columns=list(columns), use_threads=False)
        return np.column_stack([table[column].cast("float64").to_numpy() for column in columns])

    def along(quantity: str) -> FloatArray | None:
        columns = [f"{prefix}{quantity}_{axis}" for axis in "ned"]
        return read(*columns) if names.issuperset(columns) else None

    time, status = read("time")[:, 0], read("status")[:, 0]
    position = read(*(prefix + column for column in _PLACE))
    _check(name, time, position)
    facts = _facts(name, file.schema_arrow.metadata or {})
    # A method that does not estimate positions hands on the antenna's.
    own = "IMU" if "position_std_n" in names else "GNSS antenna, interpolated"
    track = Track(
        name=str(facts.get("source") or name),
        point="reference point" if use_reference else own,
        time=time,
        position_llh=position,
        position_std=along("position_std"),
        velocity_ned=along("velocity"),
        velocity_std=along("velocity_std"),
        coasting=np.asarray((status.astype(np.uint32) & np.uint32(Status.COASTING)) != 0),
        meta=facts,
    )
    known: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(position), axis=1)
    return track.rows(known)


def _check(name: str, time: FloatArray, position: FloatArray) -> None:
    if not np.isfinite(time).all() or (np.diff(time) <= 0.0).any():
        raise LogError(f"{name}: the time does not advance on every row; estimate it again.")
    if (np.abs(position[:, 0]) > np.pi / 2.0).any() or (np.abs(position[:, 1]) > 2.0 * np.pi).any():
        raise LogError(f"{name}: a position is beyond the globe; a result has latitude and longitude in radians.")


def _facts(name: str, metadata: Mapping[bytes, bytes]) -> dict[str, object]:
    """Return what the metadata tell of the log."""
    if RESULT_KEY not in metadata:
        return {}
    try:
        content = json.loads(metadata[RESULT_KEY])
    except ValueError as error:
        raise LogError(f"{name}: the metadata levelhead are not JSON ({error}); estimate it again.") from None
    content = content if isinstance(content, dict) else {}
    log = content.get("log")
    known = {**(log if isinstance(log, dict) else {}), **content}
    datum, height = (str(known[key]) if known.get(key) is not None else None for key in (DATUM_KEY, HEIGHT_KEY))
    kept = {key: known[key] for key in ("epoch", "gnss_time_scale", "source") if known.get(key) is not None}
    return {**kept, **declared(name, datum=datum, height=height)}
