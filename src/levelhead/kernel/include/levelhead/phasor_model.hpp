// The error model of the phasor filter: velocity nu, tilt theta, gyro bias beta_g and accelerometer bias beta_a as complex
// numbers x + iy in a level frame that turns with the vehicle, and the covariance of the four. Errors are estimate - truth,
// beta is what is left in the compensated readings, variances are per axis.
//     nu' = -i w nu + i g theta + beta_a        theta' = -i w theta + beta_g        (docs/theory/phasor.md)
#ifndef LEVELHEAD_PHASOR_MODEL_HPP
#define LEVELHEAD_PHASOR_MODEL_HPP

#include "complex.hpp"
#include "dcm.hpp"

namespace levelhead {

// The rows nu and theta of the transition over an interval; a bias stays itself.
template <class S>
struct Transition {
    Complex<S> nn, nt, ng, na, tt, tg, ta;
};

// Over a time T with a total turn phi at an even rate, exactly. `gravity` is the mean vertical specific force.
template <class S>
Transition<S> transition(S length, S phi, S gravity) {
    const S q = phi * phi;
    const RotationCoefficients<S> k = rotation_coefficients(q);
    // integral of (1-u) e^{i phi u} over [0, 1]; its imaginary part (phi - sin phi)/phi^2 as a series where it cancels.
    const S third = select(q > S(0.0625), (S(1) - k.a) / maximum(q, S(0.0625)), S(1.0 / 6) - q * (S(1.0 / 120) - q * S(1.0 / 5040)));
    const Complex<S> turned = {S(1) - q * k.b, -phi * k.a};  // e^{-i phi}
    const Complex<S> once = {k.a, phi * k.b}, twice = {k.b, phi * third};
    const Complex<S> driven = turned * once * length;
    Transition<S> f;
    f.nn = f.tt = turned;
    f.nt = times_i(turned) * (gravity * length);
    f.ng = times_i(turned * twice) * (gravity * length * length);
    f.na = f.tg = driven;
    f.ta = {S(0), S(0)};
    return f;
}

// Hermitian: the entry of a row and a later column; the other half is its conjugate.
template <class S>
struct PhasorCovariance {
    S nn, tt, gg, aa;
    Complex<S> nt, ng, na, tg, ta, ga;
};

// What an interval adds: white noise of the readings, random walks of the biases.
template <class S>
struct PhasorNoise {
    S gyro, accel, gyro_walk, accel_walk;  // variance per second: (rad/s)^2 s, (m/s^2)^2 s, and of the biases per s
};

// P <- F P F^H.
template <class S>
void propagate(PhasorCovariance<S>& p, const Transition<S>& f) {
    const Complex<S> tn = conj(p.nt), gn = conj(p.ng), an = conj(p.na), gt = conj(p.tg), at = conj(p.ta), ag = conj(p.ga);
    const Complex<S> m_nn = f.nn * p.nn + f.nt * tn + f.ng * gn + f.na * an;
    const Complex<S> m_nt = f.nn * p.nt + f.nt * p.tt + f.ng * gt + f.na * at;
    const Complex<S> m_ng = f.nn * p.ng + f.nt * p.tg + f.ng * p.gg + f.na * ag;
    const Complex<S> m_na = f.nn * p.na + f.nt * p.ta + f.ng * p.ga + f.na * p.aa;
    const Complex<S> m_tt = f.tt * p.tt + f.tg * gt + f.ta * at;
    const Complex<S> m_tg = f.tt * p.tg + f.tg * p.gg + f.ta * ag;
    const Complex<S> m_ta = f.tt * p.ta + f.tg * p.ga + f.ta * p.aa;
    p.nn = inner(m_nn, f.nn) + inner(m_nt, f.nt) + inner(m_ng, f.ng) + inner(m_na, f.na);
    p.nt = m_nt * conj(f.tt) + m_ng * conj(f.tg) + m_na * conj(f.ta);
    p.ng = m_ng;
    p.na = m_na;
    p.tt = inner(m_tt, f.tt) + inner(m_tg, f.tg) + inner(m_ta, f.ta);
    p.tg = m_tg;
    p.ta = m_ta;
}

// P <- P + Q. Gyro noise tilts the platform, and tilt drives the velocity for the rest of the interval.
template <class S>
void add_noise(PhasorCovariance<S>& p, const PhasorNoise<S>& q, S length, S gravity) {
    const S t2 = S(0.5) * length * length, t3 = length * length * length * S(1.0 / 3);
    p.nn = p.nn + q.accel * length + gravity * gravity * q.gyro * t3 + q.accel_walk * t3;
    p.nt = p.nt + Complex<S>{S(0), gravity * q.gyro * t2};
    p.na.re = p.na.re + q.accel_walk * t2;
    p.tt = p.tt + q.gyro * length + q.gyro_walk * t3;
    p.tg.re = p.tg.re + q.gyro_walk * t2;
    p.gg = p.gg + q.gyro_walk * length;
    p.aa = p.aa + q.accel_walk * length;
}

template <class S>
struct PhasorVector {
    Complex<S> n, t, g, a;
};

// Fold in a measurement of the velocity with this innovation variance; returns the gain.
template <class S>
PhasorVector<S> measure_velocity(PhasorCovariance<S>& p, S innovation_variance) {
    const S w = S(1) / innovation_variance;
    const S n = p.nn;
    const Complex<S> tn = conj(p.nt), gn = conj(p.ng), an = conj(p.na);
    const PhasorVector<S> gain = {{n * w, S(0)}, tn * w, gn * w, an * w};
    // P - K (P_n:), written out; the diagonal stays real.
    p.ta = p.ta - gain.t * p.na;
    p.tg = p.tg - gain.t * p.ng;
    p.ga = p.ga - gain.g * p.na;
    p.tt = p.tt - norm2(tn) * w;
    p.gg = p.gg - norm2(gn) * w;
    p.aa = p.aa - norm2(an) * w;
    // What is left of the velocity's own row is its old value times R/S; S - P_nn would cancel.
    const S left = (innovation_variance - n) * w;
    p.nn = n * left;
    p.nt = p.nt * left;
    p.ng = p.ng * left;
    p.na = p.na * left;
    return gain;
}

template <class S>
PhasorVector<S> operator+(const PhasorVector<S>& x, const PhasorVector<S>& y) { return {x.n + y.n, x.t + y.t, x.g + y.g, x.a + y.a}; }

template <class S>
PhasorVector<S> operator*(const PhasorVector<S>& x, S s) { return {x.n * s, x.t * s, x.g * s, x.a * s}; }

template <class S>
PhasorVector<S> operator*(const PhasorVector<S>& x, const Complex<S>& z) { return {x.n * z, x.t * z, x.g * z, x.a * z}; }

template <class S>
PhasorVector<S> operator*(const Transition<S>& f, const PhasorVector<S>& x) {
    return {f.nn * x.n + f.nt * x.t + f.ng * x.g + f.na * x.a, f.tt * x.t + f.tg * x.g + f.ta * x.a, x.g, x.a};
}

// x^H y.
template <class S>
Complex<S> inner(const PhasorVector<S>& x, const PhasorVector<S>& y) {
    return conj(x.n) * y.n + conj(x.t) * y.t + conj(x.g) * y.g + conj(x.a) * y.a;
}

// A real pair "integral, rate bias": heading and vertical gyro bias, or vertical velocity and vertical accelerometer bias.
template <class S>
struct PairCovariance {
    S xx, xb, bb;
};

template <class S>
struct PairGain {
    S x, b;
};

template <class S>
void propagate(PairCovariance<S>& p, S length, S noise, S walk) {
    p.xx = p.xx + S(2) * length * p.xb + length * length * p.bb + noise * length + walk * length * length * length * S(1.0 / 3);
    p.xb = p.xb + length * p.bb + S(0.5) * walk * length * length;
    p.bb = p.bb + walk * length;
}

template <class S>
PairGain<S> measure(PairCovariance<S>& p, S variance) {
    const S w = S(1) / (p.xx + variance), left = variance * w;
    const PairGain<S> gain = {p.xx * w, p.xb * w};
    p.bb = p.bb - p.xb * gain.b;
    p.xx = p.xx * left;
    p.xb = p.xb * left;
    return gain;
}

// P <- P + part of v v^H that is circular: what a real number of this variance, seen through v, adds to each axis.
template <class S>
void add_circular(PhasorCovariance<S>& p, const PhasorVector<S>& v, S variance) {
    const PhasorVector<S> w = v * (S(0.5) * variance);
    p.nn = p.nn + inner(w.n, v.n);
    p.tt = p.tt + inner(w.t, v.t);
    p.gg = p.gg + inner(w.g, v.g);
    p.aa = p.aa + inner(w.a, v.a);
    p.nt = p.nt + w.n * conj(v.t);
    p.ng = p.ng + w.n * conj(v.g);
    p.na = p.na + w.n * conj(v.a);
    p.tg = p.tg + w.t * conj(v.g);
    p.ta = p.ta + w.t * conj(v.a);
    p.ga = p.ga + w.g * conj(v.a);
}

// A heading error turns the specific force, nu' = ... + i f psi. That has a direction, so it would spoil the circular
// covariance; it is kept apart, as in Friedland's separate-bias filter: the errors are what the covariance says, plus x times
// the heading error and b times the error of the vertical gyro bias. All parts stay positive whatever happens.
template <class S>
struct HeadingShare {
    PhasorVector<S> x, b;
};

// What the shares add to the variance of a component, per axis.
template <class S>
S shared_variance(const PairCovariance<S>& pair, const Complex<S>& x, const Complex<S>& b) {
    return S(0.5) * (pair.xx * norm2(x) + S(2) * pair.xb * inner(x, b) + pair.bb * norm2(b));
}

// White noise has gone into one of the pair, whose share is `own`: that is news that the four have not felt yet. `variance` is
// the one's own where the other is known, `slope` the other's share in it.
template <class S>
void take_news(PhasorVector<S>& own, PhasorVector<S>& other, PhasorCovariance<S>& p, S noise, S variance, S slope) {
    if (!(noise > S(0))) return;
    const S part = noise / maximum(variance, noise);
    add_circular(p, own, noise * (S(1) - part));
    other = other + own * (part * slope);
    own = own * (S(1) - part);
}

// Over an interval in which the specific force added `push`: i times the velocity that it gave. Moves the pair as
// well; `noise` is what the heading gathers in all, `walk` that of the bias per second.
template <class S>
void propagate(PairCovariance<S>& pair, HeadingShare<S>& share, PhasorCovariance<S>& p, const Transition<S>& f, const Complex<S>& push,
               S length, S noise, S walk) {
    share.x = f * share.x;
    share.x.n = share.x.n + push;
    // In terms of the new heading the old one is less by what the bias has turned it.
    share.b = f * share.b + share.x * -length;
    share.b.n = share.b.n + push * (S(0.5) * length);
    propagate(pair, length, S(0), S(0));
    pair.xx = pair.xx + noise;
    take_news(share.x, share.b, p, noise, pair.xx - pair.xb * pair.xb / pair.bb, pair.xb / pair.bb);
    pair.xx = pair.xx + walk * length * length * length * S(1.0 / 3);
    pair.xb = pair.xb + S(0.5) * walk * length * length;
    pair.bb = pair.bb + walk * length;
    take_news(share.b, share.x, p, walk * length, pair.bb - pair.xb * pair.xb / pair.xx, pair.xb / pair.xx);
}

// What the velocity innovation z tells of the pair: psi gains Re(conj(x) z), the bias Re(conj(b) z). `seen` is the share of
// the pair in the velocity before.
template <class S>
struct HeadingGain {
    Complex<S> seen_x, seen_b, x, b;
};

// One real measurement of the pair through (hx, hb).
template <class S>
PairGain<S> measure(PairCovariance<S>& p, S hx, S hb, S variance) {
    const S px = p.xx * hx + p.xb * hb, pb = p.xb * hx + p.bb * hb, w = S(1) / (variance + hx * px + hb * pb);
    p.xx = p.xx - px * px * w;
    p.xb = p.xb - px * pb * w;
    p.bb = p.bb - pb * pb * w;
    return {px * w, pb * w};
}

// `variance` is that of the innovation without the pair's part, `gain` what the four take from it.
template <class S>
HeadingGain<S> measure_velocity(PairCovariance<S>& pair, HeadingShare<S>& share, const PhasorVector<S>& gain, S variance) {
    const Complex<S> x = share.x.n, b = share.b.n;
    // The real part, then the imaginary part, of which the first has already told something.
    const PairGain<S> first = measure(pair, x.re, b.re, variance), second = measure(pair, x.im, b.im, variance);
    const S told = x.im * first.x + b.im * first.b;
    share.x = share.x + gain * (-x);
    share.b = share.b + gain * (-b);
    return {x, b, {first.x - second.x * told, second.x}, {first.b - second.b * told, second.b}};
}

}  // namespace levelhead

#endif
