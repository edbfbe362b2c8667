"""Datums: what lies within a metre of WGS84 is taken, the rest refused, and two files of one log agree."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from levelhead.errors import LogError, UsageError
from levelhead.logs.datum import checked_datum
from levelhead.logs.log import Log
from levelhead.logs.mapping import load_mapping
from levelhead.logs.readers import read
from levelhead.logs.writers import write

Writer = Callable[[str, str], Path]

IMU = "time,gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z\n0,1,2,3,4,5,6\n1,1,2,3,4,5,6\n2,1,2,3,4,5,6\n"
GNSS = "t,a,b,h\n0.5,50,8,100\n1.5,50,8,100\n"
GNSS_MAPPING = '[gnss]\ncolumns = { time = "t", lat = "a", lon = "b", height = "h" }\n'
POS = (
    "% (lat/lon/height={datum},Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp,ns=# of satellites)\n"
    "%  GPST  latitude(deg) longitude(deg) height(m) Q ns\n"
    "1970/01/01 00:00:00.500 50.0 8.0 100.0 1 21\n1970/01/01 00:00:01.500 50.0 8.0 100.0 1 21\n"
)


@pytest.mark.parametrize(
    "name",
    [
        *("WGS84", "WGS 84", "wgs-84", "WGS84(G2139)", "EPSG:4979", "ITRF2020", "ITRF08", "IGS14", "IGb14", "PZ-90.11"),
        *("ETRS89", "ETRF2000", "RGF93", "GDA2020", "CGCS2000", "SIRGAS 2000", "JGD2011"),
    ],
)
def test_what_lies_within_a_metre_is_taken(name: str) -> None:
    assert checked_datum("a.csv", name) == name


@pytest.mark.parametrize(
    "name",
    [
        *("NAD27", "NAD83(2011)", "ED50", "Tokyo", "Pulkovo 1942", "GCJ-02", "BD-09", "OSGB36", "AGD66", "GDA94"),
        *("CH1903+", "DHDN", "MGI", "NTF"),
    ],
)
def test_what_lies_further_off_is_refused_with_the_distance_and_the_way_out(name: str) -> None:
    with pytest.raises(LogError, match=re.escape(f"a.csv: the datum is {name!r}, whose positions lie")) as caught:
        checked_datum("a.csv", name)
    assert "convert the positions to WGS84 (EPSG:4979)" in str(caught.value)


@pytest.mark.parametrize("name", ["", "WGS72", "PZ-90", "local grid", "WGS84 roughly"])
def test_an_unknown_datum_is_refused_too(name: str) -> None:
    with pytest.raises(LogError, match=f"the datum '{name}' is not known to lie within a metre of WGS84; convert"):
        checked_datum("a.csv", name)


def test_a_log_is_in_wgs84_unless_it_says_otherwise(drive: Log) -> None:
    assert drive.meta["datum"] == "WGS84"
    assert "height" not in drive.meta
    assert replace(drive, meta={"datum": "ITRF2020"}).meta["datum"] == "ITRF2020"
    with pytest.raises(LogError, match="The log's meta: the datum is 'Tokyo', whose positions lie some 400 m off"):
        replace(drive, meta={"datum": "Tokyo"})
    with pytest.raises(LogError, match="The log's meta: the heights count from 'the floor'; declare one of 'ellipsoid"):
        replace(drive, meta={"height": "the floor"})


def test_a_mapping_declares_datum_and_heights(put: Writer) -> None:
    mapping = put("m.toml", GNSS_MAPPING + 'datum = "ETRS89"\nheight = "mean sea level"\n')
    log = read(put("a.csv", IMU), gnss=put("b.csv", GNSS), mapping=mapping)
    assert (log.meta["datum"], log.meta["height"]) == ("ETRS89", "mean sea level")
    plain = read(put("a.csv", IMU), gnss=put("b.csv", GNSS), mapping=put("m.toml", GNSS_MAPPING))
    assert plain.meta["datum"] == "WGS84"
    with pytest.raises(LogError, match=r"m\.toml, \[gnss\]: the datum is 'NAD27', whose positions lie up to 200 m off"):
        load_mapping(put("m.toml", GNSS_MAPPING + 'datum = "NAD27"\n'))
    with pytest.raises(LogError, match=r"m\.toml, \[gnss\]: the heights count from 'geoid'; declare one of 'ellips"):
        load_mapping(put("m.toml", GNSS_MAPPING + 'height = "geoid"\n'))
    with pytest.raises(UsageError, match=r"m\.toml, \[gnss\]: datum is 84; write text in quotation marks\."):
        load_mapping(put("m.toml", GNSS_MAPPING + "datum = 84\n"))


def test_parquet_keeps_datum_heights_and_time_scale_and_refuses_a_foreign_one(drive: Log, tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    meta = {"datum": "ETRS89", "height": "mean sea level", "gnss_time_scale": "UTC"}
    write(replace(drive, meta=meta), path)
    assert {key: read(path).meta[key] for key in meta} == meta
    table = pq.read_table(path)
    pq.write_table(table.replace_schema_metadata({b"datum": b"OSGB36"}), path)
    with pytest.raises(LogError, match=r"a\.parquet: the datum is 'OSGB36', whose positions lie some 100 m off"):
        read(path)


@pytest.mark.parametrize(
    ("declared", "datum", "height"),
    [
        ("WGS84/ellipsoidal", "WGS84", "ellipsoidal"),
        ("WGS84/geodetic", "WGS84", "mean sea level"),
        ("ETRS89/ellipsoidal", "ETRS89", "ellipsoidal"),
    ],
)
def test_the_header_of_rtklib_declares_both(put: Writer, declared: str, datum: str, height: str) -> None:
    log = read(put("a.csv", IMU), gnss=put("b.pos", POS.format(datum=declared)))
    assert (log.meta["datum"], log.meta["height"]) == (datum, height)


def test_a_datum_of_rtklib_that_is_not_wgs84_is_refused(put: Writer) -> None:
    with pytest.raises(LogError, match=r"b\.pos: the datum is 'Tokyo', whose positions lie some 400 m off in WGS84"):
        read(put("a.csv", IMU), gnss=put("b.pos", POS.format(datum="Tokyo/ellipsoidal")))


@pytest.mark.parametrize(
    ("ours", "theirs", "sentence"),
    [
        ({b"datum": b"ETRS89"}, "WGS84/ellipsoidal", "a.parquet declares the datum 'ETRS89', b.pos 'WGS84'; convert"),
        (
            {b"height": b"mean sea level"},
            "WGS84/ellipsoidal",
            "declares the height reference 'mean sea level', b.pos 'ell",
        ),
        # Realisations of the global frame are one datum, and who declares nothing agrees with any.
        ({b"datum": b"ITRF2020"}, "WGS84/ellipsoidal", None),
        ({}, "ETRS89/geodetic", None),
    ],
)
def test_two_files_of_one_log_agree(
    put: Writer, tmp_path: Path, ours: dict[bytes, bytes], theirs: str, sentence: str | None
) -> None:
    import pyarrow.csv

    table = pyarrow.csv.read_csv(put("a.csv", IMU)).replace_schema_metadata(ours)
    pq.write_table(table, tmp_path / "a.parquet")
    gnss = put("b.pos", POS.format(datum=theirs))
    if sentence is None:
        np.testing.assert_array_equal(read(tmp_path / "a.parquet", gnss=gnss).gnss_time, [0.5, 1.5])
        return
    with pytest.raises(LogError, match=re.escape(sentence)):
        read(tmp_path / "a.parquet", gnss=gnss)
