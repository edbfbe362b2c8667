"""The phasor error model, derived again by computer algebra: strapdown equations in, the header's numbers out.

`docs/theory/phasor.md` derives the same by hand. Nothing here reads the header but the last tests, which compile it.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp

import levelhead as lh

t, T, w, g, eps, phi = sp.symbols("t T w g epsilon phi", real=True)
u, s = sp.symbols("u s", real=True)
q_g, q_a, q_gw, q_aw = sp.symbols("q_g q_a q_gw q_aw", positive=True)
J = sp.I


def skew(a: sp.Matrix) -> sp.Matrix:
    return sp.Matrix([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def vee(m: sp.Matrix) -> sp.Matrix:
    return sp.Matrix([m[2, 1], m[0, 2], m[1, 0]])


def about_down(angle: sp.Expr) -> sp.Matrix:
    return sp.Matrix(
        [[sp.cos(angle), -sp.sin(angle), 0], [sp.sin(angle), sp.cos(angle), 0], [0, 0, 1]],
    )


def first_order(expression: sp.Matrix) -> sp.Matrix:
    """Return the coefficient of epsilon: the linearised error."""
    return expression.diff(eps).subs(eps, 0)


def phasor(vector: sp.Matrix) -> sp.Expr:
    return vector[0] + J * vector[1]


# A level vehicle turning about the vertical, with every error at its first order in epsilon.
alpha = sp.Function("alpha", real=True)(t)
force = sp.Matrix((*sp.symbols("f_x f_y", real=True), -g))
tilt = sp.Matrix([sp.Function(f"theta_{n}", real=True)(t) for n in ("N", "E", "D")])
bias_g = sp.Matrix(sp.symbols("bg_x bg_y bg_z", real=True))
bias_a = sp.Matrix(sp.symbols("ba_x ba_y ba_z", real=True))
C = about_down(alpha)
RATE = sp.Matrix([0, 0, w])
to_level = about_down(-alpha)


def strapdown_errors() -> tuple[sp.Matrix, sp.Matrix]:
    """Return nu' and theta' in NED, linearised, from the navigation equations of truth and of estimate."""
    c_hat = (sp.eye(3) + eps * skew(tilt)) * C
    velocity_rate = c_hat * (force + eps * bias_a) - C * force  # gravity drops out
    # C_hat' = C_hat [(w + beta_g) x] and also (eps [theta' x]) C + (I + eps [theta x]) C'.
    c_rate = C * skew(RATE)
    excess = c_hat * skew(RATE + eps * bias_g) - (sp.eye(3) + eps * skew(tilt)) * c_rate
    return first_order(velocity_rate), vee(sp.simplify(first_order(excess) * C.T))


def test_strapdown_errors_of_a_level_vehicle_are_two_phasors() -> None:
    nu_rate, tilt_rate = strapdown_errors()
    level_tilt = to_level * tilt
    theta, psi = phasor(level_tilt), tilt[2]
    # In the turning frame x_L = R(-alpha) x, so x_L' = R(-alpha) x' - i w x_L; the second part is the model's own.
    nu_driven = sp.expand(phasor(to_level * nu_rate))
    model = J * g * theta + phasor(bias_a) + J * phasor(force) * psi
    assert sp.simplify(sp.expand(nu_driven - model)) == 0
    assert sp.simplify(sp.expand(phasor(to_level * tilt_rate) - phasor(bias_g))) == 0
    # The vertical: heading integrates the vertical gyro bias, the vertical velocity its accelerometer's.
    assert sp.simplify(tilt_rate[2] - bias_g[2]) == 0
    seen = nu_rate[2] - bias_a[2]
    # What the vertical takes from the tilt (f_y theta_x - f_x theta_y) has no place in the pair: it is second order
    # wherever the horizontal force averages out.
    f = to_level * (C * force)
    assert sp.simplify(sp.expand(seen - (level_tilt[0] * f[1] - level_tilt[1] * f[0]))) == 0


def test_the_turning_frame_adds_minus_i_w() -> None:
    x_n, x_e = sp.Function("x_n", real=True)(t), sp.Function("x_e", real=True)(t)
    level = sp.exp(-J * alpha) * (x_n + J * x_e)
    driven = sp.exp(-J * alpha) * (x_n.diff(t) + J * x_e.diff(t))
    assert sp.simplify(level.diff(t) - (driven - J * alpha.diff(t) * level)) == 0


def test_gravity_stands_for_the_mean_vertical_force() -> None:
    # With a vertical acceleration the factor of the tilt is what the accelerometers feel upwards, g - a_down.
    up = sp.symbols("up", positive=True)
    raised = sp.Matrix([force[0], force[1], -up])
    nu_rate = first_order((sp.eye(3) + eps * skew(tilt)) * C * raised)
    theta = phasor(to_level * tilt)
    left = sp.expand(phasor(to_level * nu_rate) - J * up * theta - J * phasor(force) * tilt[2])
    assert sp.simplify(left) == 0


# ---- the transition ----

A = sp.Matrix([[-J * w, J * g, 0, 1], [0, -J * w, 1, 0], [0, 0, 0, 0], [0, 0, 0, 0]])


def closed_form(length: sp.Expr, angle: sp.Expr) -> sp.Matrix:
    """Return the transition as `transition()` in phasor_model.hpp has it."""
    a, b = sp.sin(angle) / angle, (1 - sp.cos(angle)) / angle**2
    once = a + J * angle * b
    twice = b + J * angle * (1 - a) / angle**2
    turned = 1 - angle**2 * b - J * angle * a
    driven = turned * once * length
    return sp.Matrix(
        [
            [turned, J * turned * g * length, J * turned * twice * g * length**2, driven],
            [0, turned, driven, 0],
            [0, 0, 1, 0],
            [0, 0, 0, 1],
        ]
    )


def test_the_header_s_integrals_are_what_they_are_called() -> None:
    k = sp.symbols("k", positive=True)
    a, b = sp.sin(k) / k, (1 - sp.cos(k)) / k**2
    once = sp.integrate(sp.exp(J * k * u), (u, 0, 1))
    twice = sp.integrate((1 - u) * sp.exp(J * k * u), (u, 0, 1))
    assert sp.simplify(sp.expand((once - (a + J * k * b)).rewrite(sp.exp))) == 0
    assert sp.simplify(sp.expand((twice - (b + J * (k - sp.sin(k)) / k**2)).rewrite(sp.exp))) == 0
    sinc = sp.exp(-J * k / 2) * sp.sin(k / 2) / (k / 2)
    assert sp.simplify(sp.expand((sp.exp(-J * k) * once - sinc).rewrite(sp.exp))) == 0


def test_the_transition_solves_the_error_model_exactly() -> None:
    k = sp.symbols("k", positive=True)  # the yaw rate
    length = sp.symbols("tau", positive=True)
    f = closed_form(length, k * length)
    residual = f.diff(length) - A.subs(w, k) * f
    assert residual.applyfunc(lambda x: sp.simplify(sp.expand(x.rewrite(sp.exp)))) == sp.zeros(4)
    assert f.applyfunc(lambda x: sp.limit(x, length, 0)) == sp.eye(4)


def test_a_heading_error_pushes_the_velocity_by_i_times_what_the_force_gave() -> None:
    # nu' = -i w nu + i f psi with f(t) in the turning frame: at its end nu = i psi conj(e^{i alpha_T}) dv
    # with dv = int e^{i alpha} f, the velocity gained in NED. Any f and any turn: variation of constants.
    f = sp.Function("f")(s)
    turn = sp.Function("a", real=True)
    psi = sp.symbols("psi", real=True)
    nu = J * psi * sp.exp(-J * turn(T)) * sp.Integral(sp.exp(J * turn(s)) * f, (s, 0, T))
    expected = -J * turn(T).diff(T) * nu + J * f.subs(s, T) * psi
    assert sp.simplify(nu.diff(T) - expected) == 0


# ---- the noise ----


def exact_noise() -> sp.Matrix:
    """Return the noise gathered over T: integral of F(s) G q G^H F(s)^H over the time s left after each instant."""
    k = sp.symbols("k", positive=True)
    left = sp.symbols("s", positive=True)
    f = closed_form(left, k * left)
    density = sp.diag(q_a, q_g, q_gw, q_aw)
    integrand = (f * density * f.H).applyfunc(lambda x: sp.series(sp.expand(x.rewrite(sp.exp)), k, 0, 2).removeO())
    return integrand.applyfunc(lambda x: sp.integrate(sp.expand(x), (left, 0, T)))


def test_add_noise_keeps_the_leading_terms() -> None:
    exact = exact_noise()
    k = sp.symbols("k", positive=True)
    straight = exact.subs(k, 0).applyfunc(sp.expand)
    n, th, bg, ba = range(4)
    # Per source, the header keeps on a straight ...
    assert (
        sp.expand(straight[n, n] - (q_a * T + g**2 * q_g * T**3 / 3 + q_aw * T**3 / 3 + g**2 * q_gw * T**5 / 20)) == 0
    )
    assert sp.expand(straight[n, th] - (J * g * q_g * T**2 / 2 + J * g * q_gw * T**4 / 8)) == 0
    assert sp.expand(straight[n, ba] - q_aw * T**2 / 2) == 0
    assert sp.expand(straight[th, th] - (q_g * T + q_gw * T**3 / 3)) == 0
    assert sp.expand(straight[th, bg] - q_gw * T**2 / 2) == 0
    assert sp.expand(straight[bg, bg] - q_gw * T) == 0
    assert sp.expand(straight[ba, ba] - q_aw * T) == 0
    # ... everything but what the walk of the gyro bias does to the velocity: T^3/6 and higher.
    assert sp.expand(straight[n, bg] - J * g * q_gw * T**3 / 6) == 0
    assert straight[th, ba] == 0
    assert straight[bg, ba] == 0


def test_white_noise_is_gathered_exactly_in_any_turn() -> None:
    # The turn takes tilt and velocity round together, so it cancels; only the walks of the biases feel it.
    k, left = sp.symbols("k s", positive=True)
    f = closed_form(left, k * left)
    gathered = f * sp.diag(q_a, q_g, 0, 0) * f.H
    white = gathered.applyfunc(lambda x: sp.integrate(sp.simplify(sp.expand(x.rewrite(sp.exp))), (left, 0, T)))
    expected = sp.zeros(4)
    expected[0, 0] = q_a * T + g**2 * q_g * T**3 / 3
    expected[0, 1], expected[1, 0] = J * g * q_g * T**2 / 2, -J * g * q_g * T**2 / 2
    expected[1, 1] = q_g * T
    assert (white - expected).applyfunc(sp.simplify) == sp.zeros(4)


def test_a_turn_changes_what_the_walks_add_by_one_more_power_of_it() -> None:
    exact, k = exact_noise(), sp.symbols("k", positive=True)
    for entry, source in ((exact[0, 3], q_aw), (exact[1, 2], q_gw)):
        leading, turned = (sp.expand(entry).coeff(source).coeff(k, power) for power in (0, 1))
        assert sp.simplify(leading - T**2 / 2) == 0
        assert sp.simplify(turned + J * T**3 / 6) == 0  # a third of w T, at most 0.35/3
    for i in (0, 1):
        assert sp.expand(exact[i, i]).coeff(k, 1) == 0


# ---- Hermitian and real ----


def real(m: sp.Matrix) -> sp.Matrix:
    """Return the real embedding: multiplication by x + iy as a 2 x 2 block, all real parts first."""
    re, im = m.applyfunc(sp.re), m.applyfunc(sp.im)
    return sp.Matrix(sp.BlockMatrix([[re, -im], [im, re]]))


def symbols(name: str, rows: int, columns: int) -> sp.Matrix:
    def entry(i: int, j: int) -> sp.Expr:
        x, y = sp.symbols(f"{name}x_{i}{j} {name}y_{i}{j}", real=True)
        return x + J * y

    return sp.Matrix(rows, columns, entry)


def test_the_hermitian_covariance_is_the_real_one() -> None:
    # Products, sums and the adjoint carry over, so F P F^H + Q and K = P H^H / S are the real filter's, each once
    # instead of twice. Two by two shows it: the entries of a larger product are sums of such.
    a, b = symbols("a", 2, 2), symbols("b", 2, 2)
    assert (real(a * b) - real(a) * real(b)).applyfunc(sp.expand) == sp.zeros(4)
    assert (real(a.H) - real(a).T).applyfunc(sp.expand) == sp.zeros(4)
    assert real(sp.eye(2)) == sp.eye(4)


def test_a_circular_vector_has_one_covariance_of_each_kind() -> None:
    # z = x + iy with E[z z^T] = 0, and P = E[z z^H] / 2: the real covariance of (x, y) is the embedding of P.
    yx = sp.Matrix(2, 2, sp.symbols("c_:4", real=True))
    a, b, d, e, f, h = sp.symbols("a b d e f h", real=True)
    xx, yy = sp.Matrix([[a, b], [b, d]]), sp.Matrix([[e, f], [f, h]])
    unlike = xx - yy + J * (yx + yx.T)  # E[z z^T]
    equations = [*unlike.applyfunc(sp.re), *unlike.applyfunc(sp.im)]
    circular = sp.solve(equations, [e, f, h, yx[0, 0], yx[0, 1], yx[1, 1]], dict=True)[0]
    p = (xx + yy + J * (yx - yx.T)) / 2
    covariance = sp.Matrix(sp.BlockMatrix([[xx, yx.T], [yx, yy]]))
    assert (real(p) - covariance).subs(circular).applyfunc(sp.expand) == sp.zeros(4)


def test_a_measurement_of_the_velocity_divides_by_one_real_number() -> None:
    rng = np.random.default_rng(0)
    root = rng.standard_normal((4, 4)) + 1j * rng.standard_normal((4, 4))
    p = root @ root.conj().T
    r = 0.3

    def embed(m: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
        return np.block([[m.real, -m.imag], [m.imag, m.real]])

    h = np.zeros((1, 4))
    h[0, 0] = 1.0
    gain = p @ h.T / (p[0, 0].real + r)
    big, hh = embed(p), embed(h.astype(complex))
    innovation = hh @ big @ hh.T + r * np.eye(2)
    np.testing.assert_allclose(innovation, (p[0, 0].real + r) * np.eye(2), atol=1e-12)
    np.testing.assert_allclose(big @ hh.T @ np.linalg.inv(innovation), embed(gain), atol=1e-12)


# ---- what the header computes ----

PROGRAM = r"""
#include <cstdio>
#include <cstdlib>
#include <levelhead/phasor_model.hpp>
using namespace levelhead;
static void put(Complex<double> z) { std::printf("%.17g %.17g\n", z.re, z.im); }
int main(int, char** v) {
    const double length = atof(v[1]), phi = atof(v[2]), gravity = atof(v[3]);
    const Transition<double> f = transition(length, phi, gravity);
    put(f.nn); put(f.nt); put(f.ng); put(f.na); put(f.tt); put(f.tg); put(f.ta);
    PhasorCovariance<double> p{};
    add_noise(p, PhasorNoise<double>{2.0, 3.0, 5.0, 7.0}, length, gravity);
    put({p.nn, 0}); put(p.nt); put(p.ng); put(p.na); put({p.tt, 0}); put(p.tg); put(p.ta);
    put({p.gg, 0}); put({p.aa, 0});
}
"""


@pytest.fixture(scope="module")
def header(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The header's transition and noise as a program."""
    compiler = shutil.which("c++") or shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        pytest.skip("no C++ compiler on the path")
    folder = tmp_path_factory.mktemp("model")
    source = folder / "model.cpp"
    source.write_text(PROGRAM)
    command = [compiler, "-std=c++17", f"-I{lh.get_include()}", str(source), "-o", str(folder / "model")]
    subprocess.run(command, check=True)
    return folder / "model"


def printed(header: Path, length: float, angle: float, gravity: float) -> list[complex]:
    done = subprocess.run(
        [str(header), repr(length), repr(angle), repr(gravity)], capture_output=True, text=True, check=True
    )
    return [complex(*(float(x) for x in line.split())) for line in done.stdout.splitlines()]


@pytest.mark.parametrize("angle", [1e-9, 1e-3, -0.02, 0.2499, 0.2501, -0.35, 1.0, 3.0])
def test_the_header_s_transition(header: Path, angle: float) -> None:
    length, gravity = 0.8, 9.7
    rows = closed_form(T, phi)
    expected = [
        complex(
            sp.N(rows[i, j].subs({T: sp.Float(length, 60), phi: sp.Float(angle, 60), g: sp.Float(gravity, 60)}), 30)
        )
        for i, j in [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3)]
    ]
    # The series of (phi - sin phi)/phi^3 stops after three terms: at the border, 0.25 rad, the next one is
    # 0.25^6/362880 = 7e-10 of an imaginary part that is itself phi/6; all else is exact to rounding.
    np.testing.assert_allclose(printed(header, length, angle, gravity)[:7], expected, rtol=1e-9, atol=1e-15)


def test_the_header_s_noise(header: Path) -> None:
    length, gravity = 0.8, 9.7
    values = {q_g: 2, q_a: 3, q_gw: 5, q_aw: 7, g: sp.Rational("9.7"), T: sp.Rational("0.8")}
    straight = exact_noise().subs(sp.symbols("k", positive=True), 0)
    # The terms that the filter leaves out are those of the gyro bias's walk in the velocity's row.
    for i, j in [(0, 0), (0, 1), (0, 2)]:
        straight[i, j] = sp.expand(straight[i, j]).subs(q_gw, 0)
    order = [(0, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (1, 3), (2, 2), (3, 3)]
    expected = [complex(straight[i, j].subs(values)) for i, j in order]
    np.testing.assert_allclose(printed(header, length, 0.0, gravity)[7:], expected, rtol=1e-14)
