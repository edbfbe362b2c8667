"""NumPy twin of the phasor smoother: Rauch, Tung and Striebel's, with inverses, on the ten joint real errors.

The kernel runs modified Bryson-Frazier recursions on four complex numbers and two pairs; this is another algorithm on
another arrangement of the same model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from levelhead.conventions import FloatArray
from levelhead.kernel.reference import about_down, rotation

ComplexArray = NDArray[np.complex128]


def exponential(matrix: ComplexArray) -> ComplexArray:
    """Return the matrix exponential: the Taylor series of a 64th, squared six times."""
    small, out, term = matrix / 64.0, np.eye(len(matrix), dtype=np.complex128), np.eye(len(matrix), dtype=np.complex128)
    for k in range(1, 20):
        term = term @ small / k
        out = out + term
    for _ in range(6):
        out = out @ out
    return out


def as_complex(vector: FloatArray) -> complex:
    """Return the horizontal part of a vector as x + iy."""
    return complex(vector[0], vector[1])


def as_vector(horizontal: complex, down: float = 0.0) -> FloatArray:
    """Return the vector of a horizontal part x + iy and a vertical one."""
    return np.array([horizontal.real, horizontal.imag, down])


def embedded(matrix: ComplexArray) -> FloatArray:
    """Return the real matrix that does to (Re x, Im x) what a complex one does to x."""
    return np.block([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]])


def stacked(columns: ComplexArray) -> FloatArray:
    """Return what real factors of complex columns do: real parts above imaginary ones."""
    return np.concatenate([columns.real, columns.imag])


@dataclass(frozen=True, kw_only=True)
class Measured:
    """The measurements of one epoch, on the ten joint real errors, and on the vertical pair (`lift_...`).

    The order is Re(nu, theta, beta_g, beta_a), Im(the same), heading, vertical gyro bias. `predicted` is the covariance
    before; `rows`, `seen`, `noise` are what each measurement looks at, read, and its variance; `correction` is what the
    filter took the errors to be.
    """

    predicted: FloatArray
    rows: FloatArray
    seen: FloatArray
    noise: FloatArray
    correction: FloatArray
    lift_predicted: FloatArray
    lift_correction: FloatArray

    @classmethod
    def nothing(cls, predicted: FloatArray, lift_predicted: FloatArray) -> Self:
        """Return an epoch without any."""
        none = np.empty(0)
        return cls(
            predicted=predicted,
            rows=np.empty((0, 10)),
            seen=none,
            noise=none,
            correction=np.zeros(10),
            lift_predicted=lift_predicted,
            lift_correction=np.zeros(2),
        )


@dataclass(frozen=True, kw_only=True)
class Record:
    """One epoch of the forward filter: how the errors moved there, what was measured, and the state afterwards.

    `fresh`: the attitude began anew.
    """

    time: float
    moved: FloatArray
    covariance: FloatArray
    lift_moved: FloatArray
    lift_covariance: FloatArray
    measured: Measured
    fresh: bool
    dcm_body_to_ned: FloatArray
    azimuth: complex
    velocity: FloatArray
    gyro_bias: FloatArray
    accel_bias: FloatArray


@dataclass(frozen=True, kw_only=True)
class Smoothed:
    """One smoothed epoch; `covariance` (10, 10) of the joint errors, `lift_covariance` (2, 2)."""

    time: float
    dcm_body_to_ned: FloatArray
    velocity: FloatArray
    gyro_bias: FloatArray
    accel_bias: FloatArray
    covariance: FloatArray
    lift_covariance: FloatArray


def corrected(record: Record, x: FloatArray, lift: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return attitude, velocity, gyro and accelerometer bias of a record without the joint errors x and `lift`."""
    nu, theta, beta_g, beta_a = record.azimuth * (x[:4] + 1j * x[4:8])
    c = record.dcm_body_to_ned
    tilt = np.array([theta.real, theta.imag, 0.0])
    return (
        about_down(-x[8]) @ rotation(-tilt) @ c,
        record.velocity - np.array([nu.real, nu.imag, lift[0]]),
        record.gyro_bias + c.T @ np.array([beta_g.real, beta_g.imag, x[9]]),
        record.accel_bias + c.T @ np.array([beta_a.real, beta_a.imag, lift[1]]),
    )


def smooth_reference(records: Sequence[Record]) -> list[Smoothed]:
    """Smooth the records of a forward run that was levelled once; in the records' order.

    With feedback the filter's own errors are zero after each correction, so that what the future adds, `x`, starts from
    zero at the end: before a correction the smoothed errors are that correction plus what is to come.
    """
    x, lift = np.zeros(10), np.zeros(2)
    p, lift_p = records[-1].covariance, records[-1].lift_covariance
    out: list[Smoothed] = []
    for k in range(len(records) - 1, -1, -1):
        r = records[k]
        if k + 1 < len(records):
            after, m = records[k + 1], records[k + 1].measured
            gain = r.covariance @ after.moved.T @ np.linalg.inv(m.predicted)
            x = gain @ (m.correction + x)
            p = r.covariance + gain @ (p - m.predicted) @ gain.T
            lift_gain = r.lift_covariance @ after.lift_moved.T @ np.linalg.inv(m.lift_predicted)
            lift = lift_gain @ (m.lift_correction + lift)
            lift_p = r.lift_covariance + lift_gain @ (lift_p - m.lift_predicted) @ lift_gain.T
        dcm, velocity, gyro_bias, accel_bias = corrected(r, x, lift)
        out.append(
            Smoothed(
                time=r.time,
                dcm_body_to_ned=dcm,
                velocity=velocity,
                gyro_bias=gyro_bias,
                accel_bias=accel_bias,
                covariance=p,
                lift_covariance=lift_p,
            )
        )
    return out[::-1]
