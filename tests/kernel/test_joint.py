"""Positions, directed moments and the joint smoother against dense real matrices that share nothing with the header.

The header carries five complex errors in two kinds of moments with the heading's shares beside them, and smooths
without inverses. Here the twelve real errors are one vector: matrix exponentials, textbook updates, and the smoother of
Rauch, Tung and Striebel. Every step turns, pushes, and is seen through rows of any direction and mixture.
"""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import levelhead as lh
from levelhead.conventions import FloatArray
from levelhead.kernel.reference_smoother import ComplexArray, embedded, exponential

GRAVITY = 9.8
STEPS = 25
GYRO, ACCEL, ACCEL_WALK, HEADING = 1e-7, 1e-3, 1e-6, 1e-6


@dataclass(frozen=True, kw_only=True)
class Step:
    """An interval and the rows that follow it: (12,) each, with the error seen and its variance."""

    length: float
    turn: float
    push: complex
    rows: FloatArray
    errors: FloatArray
    variances: FloatArray


def model(step: Step) -> ComplexArray:
    """The error equations' matrix (n, t, g, a, p) times the length: theory page, sections 1 and 11."""
    a = np.zeros((5, 5), dtype=np.complex128)
    turning = -1j * step.turn / step.length
    a[0, 0] = a[1, 1] = a[4, 4] = turning
    a[0, 1], a[0, 3] = 1j * GRAVITY, 1.0
    a[1, 2] = 1.0
    a[4, 0] = 1.0
    return a * step.length


def drawn(rng: np.random.Generator) -> list[Step]:
    """Turns from nothing to a third of a circle; rows as the filter has them, and some of any kind."""
    steps = []
    for k in range(STEPS):
        rows = []
        level = rng.normal(size=2)
        unit = level / np.linalg.norm(level)
        for direction in (unit, np.array([-unit[1], unit[0]])):  # a position with an arm, along and across
            row = np.zeros(12)
            row[4], row[9] = direction
            row[1], row[6] = 1.5 * direction[1], -1.5 * direction[0]
            row[10] = 0.3
            rows.append(row)
        axle = np.zeros(12)
        axle[0], axle[5], axle[10] = -unit[1], unit[0], -3.0
        course = np.zeros(12)
        course[10] = 1.0
        rate = np.zeros(12)
        rate[11] = 1.0
        rows += [axle, course, rate, rng.normal(size=12) * 0.3]
        kept = rng.permutation(len(rows))[: rng.integers(0, 5)] if k % 5 else np.arange(len(rows))
        chosen = np.array([rows[i] for i in sorted(kept)]).reshape(-1, 12)
        steps.append(
            Step(
                length=float(rng.uniform(0.05, 1.0)),
                turn=float(rng.choice([0.0, 1e-4, 0.2, -0.24, 0.26, 0.35])),
                push=complex(*rng.normal(size=2)),
                rows=chosen,
                errors=rng.normal(size=len(chosen)) * 0.1,
                variances=rng.uniform(1e-3, 1e-1, len(chosen)),
            )
        )
    return steps


def start(rng: np.random.Generator) -> tuple[ComplexArray, FloatArray]:
    """A Hermitian covariance of the five, and one of heading and vertical gyro bias."""
    scale = np.diag([0.1, 0.01, 1e-3, 0.05, 0.5])
    root = scale @ (np.eye(5) + 0.3 * (rng.normal(size=(5, 5)) + 1j * rng.normal(size=(5, 5))))
    level: ComplexArray = (root @ root.conj().T).astype(np.complex128)
    return level, np.array([[1e-3, 1e-6], [1e-6, 1e-7]])


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = shutil.which("c++")
    if compiler is None:
        pytest.skip("no C++ compiler")
    out = tmp_path_factory.mktemp("joint") / "joint_loop"
    source = Path(__file__).parent / "joint_loop.cpp"
    command = [compiler, "-std=c++17", "-O1", "-ffp-contract=off", f"-I{lh.get_include()}", str(source), "-o", str(out)]
    subprocess.run(command, check=True)
    return out


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What the header says after each step: F, Q and joint covariance; smoothed errors and variances."""

    moved: ComplexArray
    noise: ComplexArray
    covariance: FloatArray
    smoothed: FloatArray
    smoothed_variance: FloatArray


def ask(program: Path, p: ComplexArray, pair: FloatArray, steps: list[Step]) -> Answer:
    upper = np.triu_indices(5)
    numbers = [
        *p[upper].view(np.float64),
        pair[0, 0],
        pair[0, 1],
        pair[1, 1],
        GYRO,
        ACCEL,
        ACCEL_WALK,
        HEADING,
        len(steps),
    ]
    for s in steps:
        numbers += [s.length, s.turn, GRAVITY, s.push.real, s.push.imag, len(s.rows)]
        for row, error, variance in zip(s.rows, s.errors, s.variances, strict=True):
            # Re(x^H e) = Re x Re e + Im x Im e: the row's complex numbers are its two halves.
            numbers += [*np.stack([row[:5], row[5:10]], axis=1).ravel(), row[10], row[11], error, variance]
    text = " ".join(f"{float(n):.17g}" for n in numbers)
    done = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
    out = np.array(done.stdout.split(), dtype=np.float64)
    forward, backward = out[: STEPS * 198].reshape(STEPS, 198), out[STEPS * 198 :].reshape(STEPS, 24)[::-1]
    moved = np.tile(np.eye(5, dtype=np.complex128), (STEPS, 1, 1))
    f = forward[:, :24].copy().view(np.complex128)
    moved[:, 0, :4], moved[:, 1, 1:4] = f[:, :4], f[:, 4:7]
    moved[:, 4, 4], moved[:, 4, :4] = f[:, 7], f[:, 8:]
    noise = np.zeros((STEPS, 5, 5), dtype=np.complex128)
    noise[:, upper[0], upper[1]] = forward[:, 24:54].copy().view(np.complex128)
    noise += np.triu(noise, 1).conj().swapaxes(1, 2)
    return Answer(
        moved=moved,
        noise=noise,
        covariance=forward[:, 54:].reshape(STEPS, 12, 12),
        smoothed=backward[:, :12],
        smoothed_variance=backward[:, 12:],
    )


def joint_move(s: Step) -> FloatArray:
    """The transition of all twelve; a heading error pushes velocity and position, evenly over the interval."""
    out = np.eye(12)
    out[:10, :10] = embedded(exponential(model(s)))
    t = s.length
    for column, on_velocity, on_position in ((10, 1.0, t / 2.0), (11, t / 2.0, t * t / 6.0)):
        for k, part in ((0, on_velocity), (4, on_position)):
            out[k, column], out[k + 5, column] = (s.push * part).real, (s.push * part).imag
    out[10, 11] = t
    return out


@pytest.fixture(scope="module", params=[1, 2, 3])
def case(request: pytest.FixtureRequest, program: Path) -> tuple[list[Step], FloatArray, Answer]:
    rng = np.random.default_rng(request.param)
    p, pair = start(rng)
    steps = drawn(rng)
    whole = np.zeros((12, 12))
    whole[:10, :10], whole[10:, 10:] = embedded(p), pair
    return steps, whole, ask(program, p, pair, steps)


Filtered = tuple[list[FloatArray], list[FloatArray], list[FloatArray]]


def filtered(steps: list[Step], start: FloatArray, answer: Answer) -> Filtered:
    """Predicted and updated covariances, and the corrections, of a textbook's filter."""
    p, before, after, found = start, [], [], []
    for s, q in zip(steps, answer.noise, strict=True):
        f = joint_move(s)
        noise = np.zeros((12, 12))
        noise[:10, :10], noise[10, 10] = embedded(q), HEADING * s.length
        p = f @ p @ f.T + noise
        before.append(p)
        x = np.zeros(12)
        # The header is told the innovation of each row; what the rows before it found is not in it.
        for row, error, variance in zip(s.rows, s.errors, s.variances, strict=True):
            gain = p @ row / (row @ p @ row + variance)
            x = x + gain * error
            p = p - np.outer(gain, row @ p)
        after.append(p)
        found.append(x)
    return before, after, found


def test_the_transition_is_the_exponential_of_the_error_equations(
    case: tuple[list[Step], FloatArray, Answer],
) -> None:
    steps, _, answer = case
    for s, moved in zip(steps, answer.moved, strict=True):
        np.testing.assert_allclose(moved, exponential(model(s)), atol=1e-13)  # rounding, of numbers up to 10


def test_the_noise_is_its_integral(case: tuple[list[Step], FloatArray, Answer]) -> None:
    steps, _, answer = case
    nodes, weights = np.polynomial.legendre.leggauss(8)
    for s, noise in zip(steps, answer.noise, strict=True):
        if s.turn != 0.0:
            continue  # what belongs to the walks is of leading order in a turn, as the theory page says
        expected = np.zeros((5, 5), dtype=np.complex128)
        for u, w in zip(0.5 * (nodes + 1.0), 0.5 * weights, strict=True):
            f = exponential(model(s) * u)
            expected += w * s.length * f @ np.diag([ACCEL, GYRO, 0.0, ACCEL_WALK, 0.0]) @ f.conj().T
        scale = np.sqrt(np.outer(np.diag(expected).real, np.diag(expected).real)) + 1e-30
        # Left out, as there: the accelerometer walk's share in what the tilt does not touch is whole; nothing else is.
        np.testing.assert_allclose((noise / scale)[:2, :2], (expected / scale)[:2, :2], atol=1e-6)
        np.testing.assert_allclose((noise / scale)[:, 4], (expected / scale)[:, 4], atol=1e-3)


def test_the_covariance_is_the_dense_one(case: tuple[list[Step], FloatArray, Answer]) -> None:
    steps, start, answer = case
    _, after, _ = filtered(steps, start, answer)
    for ours, theirs in zip(answer.covariance, after, strict=True):
        scale = np.sqrt(np.outer(np.diag(theirs), np.diag(theirs)))
        np.testing.assert_allclose(ours / scale, theirs / scale, atol=1e-8)  # rounding over 25 steps of condition 1e6


def test_the_smoother_is_rauch_tung_and_striebel_s(case: tuple[list[Step], FloatArray, Answer]) -> None:
    steps, start, answer = case
    before, after, found = filtered(steps, start, answer)
    x, p = np.zeros(12), after[-1]
    for k in range(STEPS - 1, -1, -1):
        if k < STEPS - 1:
            # The filter feeds back: each state's error is about zero, and the next step's correction is the news of it.
            gain = after[k] @ joint_move(steps[k + 1]).T @ np.linalg.inv(before[k + 1])
            x = gain @ (x + found[k + 1])
            p = after[k] + gain @ (p - before[k + 1]) @ gain.T
        sigma = np.sqrt(np.diag(p))
        # The header's is what the estimate is to gain: less the error. Rounding, as above.
        np.testing.assert_allclose(-answer.smoothed[k] / sigma, x / sigma, atol=1e-6)
        np.testing.assert_allclose(np.sqrt(answer.smoothed_variance[k]) / sigma, 1.0, atol=1e-6)
