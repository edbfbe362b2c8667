"""KF-GINS: increments become rates without delay, text and binary alike; what is sniffed, and what is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hostile import cases
from levelhead.conventions import FloatArray
from levelhead.errors import LevelheadError, LogError
from levelhead.logs.log import Log
from levelhead.logs.pieces import ImuData
from levelhead.logs.readers import READERS, read
from levelhead.logs.readers.base import Source
from levelhead.logs.readers.kfgins import READER
from samples import kfgins as sample
from samples.drive import sample_drive


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    return sample.write(tmp_path)


def imu_of(path: Path, rows: FloatArray) -> ImuData:
    path.write_text("".join(" ".join(f"{value:.12g}" for value in row) + "\n" for row in rows), encoding="ascii")
    imu = READER.read(Source(path=path)).imu
    assert imu is not None
    return imu


def integral(time: FloatArray, values: FloatArray, at: FloatArray) -> FloatArray:
    """Return the integral of straight lines between samples, from the first sample to the instants `at`."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(time)
    whole = np.concatenate(([0.0], np.cumsum(steps)))
    k = np.clip(np.searchsorted(time, at) - 1, 0, time.size - 2)
    part = (at - time[k]) / (time[k + 1] - time[k])
    inner = (values[k] + 0.5 * part * (values[k + 1] - values[k])) * part * (time[k + 1] - time[k])
    result: FloatArray = whole[k] + inner
    return result


def test_the_drive_comes_back_as_mean_rates_in_the_middle_of_the_intervals(drive: Path) -> None:
    log, truth = read(drive), sample_drive()
    assert (log.meta["format"], log.meta["gnss_format"]) == ("kfgins", "kfgins")
    epoch = log.meta["epoch"]
    assert isinstance(epoch, float)
    middle = 0.5 * (truth.time[1:] + truth.time[:-1])
    np.testing.assert_allclose(log.time + epoch - sample.START_S, middle, atol=1e-8)  # stamps of 1e-9 s, halved sums
    # Increments of 1e-10 over 0.02 s, and stamps of 1e-9 s in it: 10 m/s^2 by 1e-7.
    np.testing.assert_allclose(log.gyro, 0.5 * (truth.gyro[1:] + truth.gyro[:-1]), atol=1e-7)
    np.testing.assert_allclose(log.accel, 0.5 * (truth.accel[1:] + truth.accel[:-1]), atol=2e-6)
    assert truth.velocity_ned is not None
    assert truth.position_llh is not None
    assert log.velocity_ned is not None
    assert log.position_llh is not None
    np.testing.assert_allclose(log.gnss_time + epoch - sample.START_S, truth.gnss_time[: log.gnss_time.size], atol=1e-6)
    np.testing.assert_allclose(log.velocity_ned, truth.velocity_ned, atol=1e-8)  # eight decimals
    np.testing.assert_allclose(log.position_llh[:, :2], truth.position_llh[:, :2], atol=2e-12)  # 1e-10 degrees
    assert log.velocity_std is not None
    assert log.position_std is not None
    np.testing.assert_allclose(log.position_std, 0.02)
    np.testing.assert_allclose(log.velocity_std, 0.05)
    assert log.meta["height"] == "ellipsoidal"


def test_the_integral_of_the_rates_is_that_of_the_increments_without_delay(tmp_path: Path) -> None:
    """A turn whose rate grows and swings: stamped a half sample off, its angle would be off by rate times that."""
    time = 1000.0 + np.arange(1, 401) / 200.0

    def angle(t: FloatArray) -> FloatArray:
        swing: FloatArray = 0.4 * (t - 1000.0) ** 2 - 0.05 * np.cos(8.0 * (t - 1000.0))
        return swing

    increments = np.diff(angle(np.concatenate(([1000.0], time))))
    zero = np.zeros(time.size)
    rows = np.column_stack((time, zero, zero, increments, zero, zero, zero - 9.8 / 200.0))
    imu = imu_of(tmp_path / "a.txt", rows)
    at = time[5:-5]
    turned = integral(imu.time, imu.gyro[:, 2], at)
    error = turned - (angle(at) - angle(imu.time[:1]))
    # The second derivative of the rate, 26 rad/s^3, times interval squared and an eighth; and 1e-14 of the text.
    assert np.abs(error).max() < 26.0 * 0.005**2 / 8.0
    rate = 0.8 * (at - 1000.0) + 0.4 * np.sin(8.0 * (at - 1000.0))
    half_late = integral(imu.time + 0.0025, imu.gyro[:, 2], at) - (angle(at) - angle(imu.time[:1] + 0.0025))
    # What it would be otherwise, so that the limit above is known to be sharp.
    assert np.abs(half_late).max() > 0.9 * 0.0025 * np.abs(rate - rate[0]).max() > 10.0 * np.abs(error).max()


def test_jittering_stamps_keep_the_integral(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    time = 1000.0 + (np.arange(1, 2001) + rng.uniform(-0.1, 0.1, 2000)) / 100.0
    increments = np.diff(np.concatenate(([1000.0], time))) * 0.3
    zero = np.zeros(time.size)
    rows = np.column_stack((time, zero, zero, increments, zero, zero, np.diff(time, prepend=1000.0) * -9.8))
    imu = imu_of(tmp_path / "a.txt", rows)
    # The first interval is not told: the usual one stands for it.
    np.testing.assert_allclose(imu.gyro[1:, 2], 0.3, rtol=2e-6)  # twelve digits of stamps at 1000 s in 0.01 s
    np.testing.assert_allclose(imu.accel[1:, 2], -9.8, rtol=2e-6)


@pytest.mark.parametrize("accumulates", [False, True])
def test_increments_across_lost_samples_are_divided_by_what_they_span(tmp_path: Path, accumulates: bool) -> None:
    time = 1000.0 + np.arange(1, 201) / 100.0
    rows = np.column_stack((time, np.full((200, 3), 2e-3), np.zeros((200, 2)), np.full(200, -0.098)))
    lost = np.zeros(200, dtype=bool)
    lost[100:104] = True
    if accumulates:
        rows[104, 1:] += rows[100:104, 1:].sum(axis=0)
    imu = imu_of(tmp_path / "a.txt", rows[~lost])
    np.testing.assert_allclose(imu.gyro, 0.2, rtol=1e-9)
    np.testing.assert_allclose(imu.accel[:, 2], -9.8, rtol=1e-9)
    assert np.diff(imu.time).max() == pytest.approx(0.03 if accumulates else 0.05, abs=1e-9)


def test_the_week_goes_on_where_it_ends(tmp_path: Path) -> None:
    time = (604799.0 + np.arange(1, 201) / 100.0) % 604800.0
    rows = np.column_stack((time, np.zeros((200, 5)), np.full(200, -0.098)))
    imu = imu_of(tmp_path / "a.txt", rows)
    np.testing.assert_allclose(np.diff(imu.time), 0.01, atol=1e-6)


def test_an_eighth_column_is_the_wheel_speed(tmp_path: Path) -> None:
    time = 1000.0 + np.arange(1, 201) / 100.0
    rows = np.column_stack((time, np.zeros((200, 5)), np.full(200, -0.098), np.full(200, 8.5)))
    imu = imu_of(tmp_path / "a.txt", rows)
    assert imu.wheel_speed is not None
    np.testing.assert_array_equal(imu.wheel_speed, 8.5)


def test_the_binary_form_is_the_same(drive: Path, tmp_path: Path) -> None:
    rows = np.loadtxt(drive)
    binary = tmp_path / "drive_imu.bin"
    rows.astype("<f8").tofile(binary)
    log, text = read(binary, gnss=tmp_path / "drive_gnss.txt"), read(drive)
    np.testing.assert_array_equal(log.gyro, text.gyro)
    np.testing.assert_array_equal(log.time, text.time)


def test_positions_without_velocities(drive: Path) -> None:
    fixes = np.loadtxt(drive.parent / "drive_gnss.txt")
    (drive.parent / "drive_gnss.txt").write_text(
        "".join("  ".join(f"{v:.10f}" for v in fix[:7]) + "\n" for fix in fixes), encoding="ascii"
    )
    log = read(drive)
    assert log.velocity_ned is None
    assert log.position_std is not None
    np.testing.assert_allclose(log.position_std, 0.02)


def test_velocities_before_sigmas_are_known_by_their_signs(drive: Path) -> None:
    path = drive.parent / "drive_gnss.txt"
    fixes = np.loadtxt(path)
    before = read(drive)
    other = np.column_stack((fixes[:, :4], fixes[:, 7:10], fixes[:, 4:7], fixes[:, 10:]))
    np.savetxt(path, other, fmt="%.10f")
    log = read(drive)
    assert log.velocity_ned is not None
    assert before.velocity_ned is not None
    np.testing.assert_allclose(log.velocity_ned, before.velocity_ned, atol=1e-8)
    fixes[:, 7:10] = np.abs(fixes[:, 7:10])
    np.savetxt(path, fixes, fmt="%.10f")
    with pytest.raises(LogError, match="columns 5 to 7 and 8 to 10 one must be velocities and one sigmas, but both"):
        read(drive)


def rows_of(number: int, *columns: float) -> bytes:
    """Return lines: a stamp that advances by 0.01 s from `number`, and the same columns on each."""
    lines = (" ".join(f"{value:.8f}" for value in (number + 0.01 * k, *columns)) for k in range(1, 50))
    return ("\n".join(lines) + "\n").encode()


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (rows_of(1000, 0.1, 0.2, 0.1, 0.1, 0.2, -9.8), "rates and forces, not increments"),
        (rows_of(1000, 0.1, 0.2, 9.8, 0.01, 0.02, 0.03), "forces first, z up: no place either"),
        (rows_of(1000, 1e-4, 1e-4, 1e-4, 1e-3, 1e-3, 0.098), "z up"),
        (rows_of(1000, 1e-3, 1e-3, -0.098, 1e-4, 1e-4, 1e-4), "velocities first"),
        (rows_of(1_700_000_000, 1e-4, 1e-4, 1e-4, 1e-3, 1e-3, -0.098), "Unix time"),
        (rows_of(1000, 1e-4, 1e-4, 1e-4, 1e-3, 1e-3, -0.098).replace(b" ", b","), "commas"),
        (rows_of(1000, 1e-4, 1e-4, 1e-4, 1e-3, -0.098), "six columns"),
        (b"t a b c d e f\n" + rows_of(1000, 1e-4, 1e-4, 1e-4, 1e-3, 1e-3, -0.098), "a header"),
        (rows_of(1000, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), "zeros"),
        (rows_of(1000, 95.0, 8.0, 100.0, 0.1, 0.1, 0.1), "no place"),
        (rows_of(1000, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0), "a trajectory with quaternions"),
        (np.arange(700.0).tobytes(), "other doubles"),
        (b"", "nothing"),
    ],
)
def test_other_numbers_are_not_taken(tmp_path: Path, content: bytes, what: str) -> None:
    assert not READER.sniff(tmp_path / "a.txt", content), what


def test_lines_as_the_public_files_have_them_are_taken(tmp_path: Path) -> None:
    """Widths, blanks at the ends and rates as in KF-GINS's own data; the numbers are others."""
    imu = "".join(
        f"{116450.0003 + 0.00497301 * k:.10f} -0.0000010849   0.0000151884    0.0000010849    0.0001218324    "
        "0.0000730994    -0.0486842096  \n"
        for k in range(20)
    )
    sigmas = "    21.095    0.010    0.009    0.019 "
    fixes = "".join(f"{456250 + k}.000    30.44478580{k}   114.47186611{k} {sigmas}\n" for k in range(9))
    for text in (imu, fixes):
        taken = [name for name, reader in READERS.items() if reader.sniff(tmp_path / "a.txt", text.encode())]
        assert taken == ["kfgins"]


def test_a_bad_line_is_named(drive: Path) -> None:
    lines = drive.read_text(encoding="ascii").splitlines(keepends=True)
    drive.write_text("".join([*lines[:700], "1 2 3\n", *lines[700:]]), encoding="ascii")
    with pytest.raises(LogError, match=r"drive_imu\.txt, line 701: the line has 3 columns where 7 are"):
        read(drive)
    drive.write_text("".join([*lines[:700], lines[700].replace(".", "x", 1), *lines[701:]]), encoding="ascii")
    with pytest.raises(LogError, match=r"drive_imu\.txt, line 701: the column number 1 holds the text"):
        read(drive)


def test_numbers_that_cannot_be_are_left_out_and_said(drive: Path) -> None:
    lines = drive.read_text(encoding="ascii").splitlines(keepends=True)
    lines[700] = lines[700][:20] + " 1e30" + lines[700][20:].lstrip().partition(" ")[2].rjust(3)
    drive.write_text("".join(lines), encoding="ascii")
    log = read(drive)
    assert log.time.size == len(lines) - 1
    damaged = next(event for event in log.events if event.code == "W_DAMAGED")
    assert "1 of 1499 rows hold numbers that cannot be, the first of them row 701" in damaged.text


def test_behind_damage_in_the_binary_form_the_next_record_is_found(drive: Path, tmp_path: Path) -> None:
    binary = tmp_path / "drive_imu.bin"
    content = np.loadtxt(drive).astype("<f8").tobytes()
    binary.write_bytes(content[: 56 * 700] + b"\xff" * 13 + content[56 * 700 :])
    log = read(binary, gnss=tmp_path / "drive_gnss.txt")
    assert log.time.size == 1499
    assert log.meta["completeness"] == "malformed_record"
    damaged = next(event for event in log.events if event.code == "W_DAMAGED")
    assert "drive_imu.bin is damaged at byte 39200" in damaged.text


@pytest.mark.parametrize("form", ["text", "binary", "gnss"])
def test_a_damaged_file_is_marked_or_refused(drive: Path, tmp_path: Path, form: str) -> None:
    gnss = tmp_path / "drive_gnss.txt"
    rows = np.loadtxt(drive)
    path = {"text": drive, "binary": tmp_path / "drive_imu.bin", "gnss": gnss}[form]
    if form == "binary":
        rows.astype("<f8").tofile(path)
    content = path.read_bytes()
    if form == "text":
        # Six seconds will do.
        content = content[: content.find(b"\n", len(content) // 5) + 1]
    imu = drive if form == "gnss" else path
    for cut in cases.beginnings(content):
        path.write_bytes(cut)
        # A file of whole records is a whole file: nothing in it says how many there were.
        whole = len(cut) % 56 == 0 if form == "binary" else cut.endswith(b"\n")
        assert whole or outcome(imu, gnss) != "complete"
    for mutated in cases.mutations(content):
        path.write_bytes(mutated)
        outcome(imu, gnss)


def outcome(path: Path, gnss: Path) -> str:
    """Return how complete a drive is read, or "refused"."""
    try:
        log: Log = read(path, gnss=gnss)
    except LevelheadError:
        return "refused"
    return str(log.meta["completeness"])
