// The error model of the phasor filter: velocity nu, tilt theta, gyro bias beta_g, accelerometer bias beta_a and position pi
// as complex numbers x + iy in a level frame that turns with the vehicle, and the covariance of the five. Errors are
// estimate - truth, beta is what is left in the compensated readings, variances are per axis.
//     pi' = -i w pi + nu        nu' = -i w nu + i g theta + beta_a        theta' = -i w theta + beta_g
// Where no positions are used the last row and column stay zero and nothing computes them. (docs/theory/phasor.md)
#ifndef LEVELHEAD_PHASOR_MODEL_HPP
#define LEVELHEAD_PHASOR_MODEL_HPP

#include "complex.hpp"
#include "dcm.hpp"

namespace levelhead {

// The rows nu, theta and pi of the transition over an interval; a bias stays itself.
template <class S>
struct Transition {
    Complex<S> nn, nt, ng, na, tt, tg, ta;
    Complex<S> pp, pn, pt, pg, pa;
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
    f.pp = f.pn = f.pt = f.pg = f.pa = {S(0), S(0)};
    return f;
}

// The position's row besides.
template <class S>
void add_position(Transition<S>& f, S length, S phi, S gravity) {
    const S q = phi * phi;
    const RotationCoefficients<S> k = rotation_coefficients(q);
    // integral of (1-u)^2/2 e^{i phi u} over [0, 1]: ((phi - sin phi) + i (phi^2/2 - 1 + cos phi)) / phi^3.
    const auto large = q > S(0.0625);
    const S safe = maximum(q, S(0.0625));
    const Complex<S> thrice = {select(large, (S(1) - k.a) / safe, S(1.0 / 6) - q * (S(1.0 / 120) - q * S(1.0 / 5040))),
                               phi * select(large, (S(0.5) - k.b) / safe, S(1.0 / 24) - q * (S(1.0 / 720) - q * S(1.0 / 40320)))};
    f.pp = f.nn;
    f.pn = f.nn * length;
    f.pt = f.nt * (S(0.5) * length);
    f.pg = times_i(f.nn * thrice) * (gravity * length * length * length);
    f.pa = times_i(f.ng) * (S(-1) / gravity);
}

// Two kinds of second moments of complex errors. P = E[x x^H]/2 is Hermitian, and the whole covariance where no direction is
// special; C = E[x x^T]/2 is symmetric and holds what has a direction. Both are the entry of a row and a later column.
struct Hermitian {
    template <class S>
    using Diagonal = S;
    template <class S>
    static Complex<S> flip(const Complex<S>& z) { return conj(z); }
    template <class S>
    static S diagonal(const Complex<S>& a, const Complex<S>& b) { return inner(a, b); }
    template <class S>
    static S own(const Complex<S>& z) { return z.re; }
    template <class V>
    static const V& toward(const V& x) { return x; }
};

struct Symmetric {
    template <class S>
    using Diagonal = Complex<S>;
    template <class S>
    static Complex<S> flip(const Complex<S>& z) { return z; }
    template <class S>
    static Complex<S> diagonal(const Complex<S>& a, const Complex<S>& b) { return a * b; }
    template <class S>
    static Complex<S> own(const Complex<S>& z) { return z; }
    template <class V>
    static V toward(const V& x) { return conj(x); }
};

template <class S, class Kind>
struct PhasorMoments {
    using Diagonal = typename Kind::template Diagonal<S>;
    Diagonal nn, tt, gg, aa;
    Complex<S> nt, ng, na, tg, ta, ga;
    Diagonal pp;
    Complex<S> np, tp, gp, ap;
};

template <class S>
using PhasorCovariance = PhasorMoments<S, Hermitian>;
template <class S>
using PhasorDirection = PhasorMoments<S, Symmetric>;

// What an interval adds: white noise of the readings, random walks of the biases.
template <class S>
struct PhasorNoise {
    S gyro, accel, gyro_walk, accel_walk;  // variance per second: (rad/s)^2 s, (m/s^2)^2 s, and of the biases per s
};

// P <- F P F^H, or C <- F C F^T; the position's row before, from what the others were.
template <class S, class Kind>
void propagate(PhasorMoments<S, Kind>& p, const Transition<S>& f) {
    const auto flip = [](const Complex<S>& z) { return Kind::flip(z); };
    const auto diagonal = [](const Complex<S>& a, const Complex<S>& b) { return Kind::diagonal(a, b); };
    const Complex<S> tn = flip(p.nt), gn = flip(p.ng), an = flip(p.na), gt = flip(p.tg), at = flip(p.ta), ag = flip(p.ga);
    const Complex<S> m_nn = f.nn * p.nn + f.nt * tn + f.ng * gn + f.na * an;
    const Complex<S> m_nt = f.nn * p.nt + f.nt * p.tt + f.ng * gt + f.na * at;
    const Complex<S> m_ng = f.nn * p.ng + f.nt * p.tg + f.ng * p.gg + f.na * ag;
    const Complex<S> m_na = f.nn * p.na + f.nt * p.ta + f.ng * p.ga + f.na * p.aa;
    const Complex<S> m_tt = f.tt * p.tt + f.tg * gt + f.ta * at;
    const Complex<S> m_tg = f.tt * p.tg + f.tg * p.gg + f.ta * ag;
    const Complex<S> m_ta = f.tt * p.ta + f.tg * p.ga + f.ta * p.aa;
    p.nn = diagonal(m_nn, f.nn) + diagonal(m_nt, f.nt) + diagonal(m_ng, f.ng) + diagonal(m_na, f.na);
    p.nt = m_nt * flip(f.tt) + m_ng * flip(f.tg) + m_na * flip(f.ta);
    p.ng = m_ng;
    p.na = m_na;
    p.tt = diagonal(m_tt, f.tt) + diagonal(m_tg, f.tg) + diagonal(m_ta, f.ta);
    p.tg = m_tg;
    p.ta = m_ta;
}

template <class S, class Kind>
void propagate_position(PhasorMoments<S, Kind>& p, const Transition<S>& f) {
    const auto flip = [](const Complex<S>& z) { return Kind::flip(z); };
    const auto diagonal = [](const Complex<S>& a, const Complex<S>& b) { return Kind::diagonal(a, b); };
    const Complex<S> m_n = f.pp * flip(p.np) + f.pn * p.nn + f.pt * flip(p.nt) + f.pg * flip(p.ng) + f.pa * flip(p.na);
    const Complex<S> m_t = f.pp * flip(p.tp) + f.pn * p.nt + f.pt * p.tt + f.pg * flip(p.tg) + f.pa * flip(p.ta);
    const Complex<S> m_g = f.pp * flip(p.gp) + f.pn * p.ng + f.pt * p.tg + f.pg * p.gg + f.pa * flip(p.ga);
    const Complex<S> m_a = f.pp * flip(p.ap) + f.pn * p.na + f.pt * p.ta + f.pg * p.ga + f.pa * p.aa;
    const Complex<S> m_p = f.pp * p.pp + f.pn * p.np + f.pt * p.tp + f.pg * p.gp + f.pa * p.ap;
    p.pp = diagonal(m_p, f.pp) + diagonal(m_n, f.pn) + diagonal(m_t, f.pt) + diagonal(m_g, f.pg) + diagonal(m_a, f.pa);
    p.np = flip(m_n * flip(f.nn) + m_t * flip(f.nt) + m_g * flip(f.ng) + m_a * flip(f.na));
    p.tp = flip(m_t * flip(f.tt) + m_g * flip(f.tg) + m_a * flip(f.ta));
    p.gp = flip(m_g);
    p.ap = flip(m_a);
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
void add_position_noise(PhasorCovariance<S>& p, const PhasorNoise<S>& q, S length, S gravity) {
    const S t2 = length * length, t3 = t2 * length, tilting = gravity * gravity * q.gyro + q.accel_walk;
    p.pp = p.pp + (q.accel * S(1.0 / 3) + tilting * t2 * S(1.0 / 20)) * t3;
    p.np.re = p.np.re + (q.accel * S(0.5) + tilting * t2 * S(1.0 / 8)) * t2;
    p.tp.im = p.tp.im - gravity * q.gyro * t3 * S(1.0 / 6);
    p.ap.re = p.ap.re + q.accel_walk * t3 * S(1.0 / 6);
}

template <class S>
struct PhasorVector {
    Complex<S> n, t, g, a, p;
};

// Fold in a measurement of the velocity with this innovation variance; returns the gain.
template <class S>
PhasorVector<S> measure_velocity(PhasorCovariance<S>& p, S innovation_variance) {
    const S w = S(1) / innovation_variance;
    const S n = p.nn;
    const Complex<S> tn = conj(p.nt), gn = conj(p.ng), an = conj(p.na);
    const PhasorVector<S> gain = {{n * w, S(0)}, tn * w, gn * w, an * w, {S(0), S(0)}};
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
PhasorVector<S> operator+(const PhasorVector<S>& x, const PhasorVector<S>& y) {
    return {x.n + y.n, x.t + y.t, x.g + y.g, x.a + y.a, x.p + y.p};
}

template <class S>
PhasorVector<S> operator*(const PhasorVector<S>& x, S s) { return {x.n * s, x.t * s, x.g * s, x.a * s, x.p * s}; }

template <class S>
PhasorVector<S> operator*(const PhasorVector<S>& x, const Complex<S>& z) {
    return {x.n * z, x.t * z, x.g * z, x.a * z, x.p * z};
}

template <class S>
PhasorVector<S> operator*(const Transition<S>& f, const PhasorVector<S>& x) {
    return {f.nn * x.n + f.nt * x.t + f.ng * x.g + f.na * x.a, f.tt * x.t + f.tg * x.g + f.ta * x.a, x.g, x.a, {S(0), S(0)}};
}

// The position's part of it.
template <class S>
Complex<S> moved_position(const Transition<S>& f, const PhasorVector<S>& x) {
    return f.pp * x.p + f.pn * x.n + f.pt * x.t + f.pg * x.g + f.pa * x.a;
}

// x^H y.
template <class S>
Complex<S> inner(const PhasorVector<S>& x, const PhasorVector<S>& y) {
    return conj(x.n) * y.n + conj(x.t) * y.t + conj(x.g) * y.g + conj(x.a) * y.a + conj(x.p) * y.p;
}

// P x, and C x (which is asked of conj(x)).
template <class S, class Kind>
PhasorVector<S> times(const PhasorMoments<S, Kind>& p, const PhasorVector<S>& x) {
    const auto flip = [](const Complex<S>& z) { return Kind::flip(z); };
    return {x.n * p.nn + p.nt * x.t + p.ng * x.g + p.na * x.a + p.np * x.p,
            flip(p.nt) * x.n + x.t * p.tt + p.tg * x.g + p.ta * x.a + p.tp * x.p,
            flip(p.ng) * x.n + flip(p.tg) * x.t + x.g * p.gg + p.ga * x.a + p.gp * x.p,
            flip(p.na) * x.n + flip(p.ta) * x.t + flip(p.ga) * x.g + x.a * p.aa + p.ap * x.p,
            flip(p.np) * x.n + flip(p.tp) * x.t + flip(p.gp) * x.g + flip(p.ap) * x.a + x.p * p.pp};
}

template <class S>
PhasorVector<S> conj(const PhasorVector<S>& x) { return {conj(x.n), conj(x.t), conj(x.g), conj(x.a), conj(x.p)}; }

// The covariance of the errors with the real number Re(h^H x): both kinds of moments together.
template <class S>
PhasorVector<S> against(const PhasorCovariance<S>& p, const PhasorDirection<S>& c, const PhasorVector<S>& h) {
    return times(p, h) + times(c, conj(h));
}

// A real pair "integral, rate bias": heading and vertical gyro bias.
template <class S>
struct PairCovariance {
    S xx, xb, bb;
};

template <class S>
struct PairGain {
    S x, b;
    S variance;  // of the innovation that it belongs to
};

template <class S>
void propagate(PairCovariance<S>& p, S length) {
    p.xx = p.xx + S(2) * length * p.xb + length * length * p.bb;
    p.xb = p.xb + length * p.bb;
}

template <class S>
PairGain<S> measure(PairCovariance<S>& p, S variance) {
    const S w = S(1) / (p.xx + variance), left = variance * w;
    const PairGain<S> gain = {p.xx * w, p.xb * w, p.xx + variance};
    p.bb = p.bb - p.xb * gain.b;
    p.xx = p.xx * left;
    p.xb = p.xb * left;
    return gain;
}

// What a real number of this variance, seen through v, adds: to P alone (the part that is the same for all directions), or to
// P and C, which is all of it.
template <class S, class Kind>
void add_seen(PhasorMoments<S, Kind>& p, const PhasorVector<S>& v, S variance, bool position = true) {
    const PhasorVector<S> w = v * (S(0.5) * variance);
    const auto flip = [](const Complex<S>& z) { return Kind::flip(z); };
    p.nn = p.nn + Kind::diagonal(w.n, v.n);
    p.tt = p.tt + Kind::diagonal(w.t, v.t);
    p.gg = p.gg + Kind::diagonal(w.g, v.g);
    p.aa = p.aa + Kind::diagonal(w.a, v.a);
    p.nt = p.nt + w.n * flip(v.t);
    p.ng = p.ng + w.n * flip(v.g);
    p.na = p.na + w.n * flip(v.a);
    p.tg = p.tg + w.t * flip(v.g);
    p.ta = p.ta + w.t * flip(v.a);
    p.ga = p.ga + w.g * flip(v.a);
    if (!position) return;
    p.pp = p.pp + Kind::diagonal(w.p, v.p);
    p.np = p.np + w.n * flip(v.p);
    p.tp = p.tp + w.t * flip(v.p);
    p.gp = p.gp + w.g * flip(v.p);
    p.ap = p.ap + w.a * flip(v.p);
}

// A heading error turns the specific force, nu' = ... + i f psi. That has a direction, so it would spoil the circular
// covariance; it is kept apart, as in Friedland's separate-bias filter: the errors are what the covariance says, plus x times
// the heading error and b times the error of the vertical gyro bias. All parts stay positive whatever happens. (With the
// directed moments C beside it only what the bias's random walk does to the heading within one interval is approximate.)
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
template <class S, class Add>
void take_news(PhasorVector<S>& own, PhasorVector<S>& other, Add add, S noise, S variance, S slope) {
    if (!(noise > S(0))) return;
    const S part = noise / maximum(variance, noise);
    add(own, noise * (S(1) - part));
    other = other + own * (part * slope);
    own = own * (S(1) - part);
}

// How a heading error, and one of the vertical gyro bias, move the others over an interval in which the specific force added
// `push`: i times the velocity that it gave, evenly.
template <class S>
HeadingShare<S> pushed(const Complex<S>& push, S length, bool position) {
    HeadingShare<S> d{};
    d.x.n = push;
    d.b.n = push * (S(0.5) * length);
    if (position) {
        d.x.p = push * (S(0.5) * length);
        d.b.p = push * (S(1.0 / 6) * length * length);
    }
    return d;
}

// Moves the pair as well; `noise` is what the heading gathers in all, `walk` that of the bias per second. `add(v, variance)`
// puts the moments of what is seen through v to those of the five.
template <class S, class Add>
void propagate(PairCovariance<S>& pair, HeadingShare<S>& share, Add add, const Transition<S>& f, const HeadingShare<S>& push,
               bool position, S length, S noise, S walk) {
    HeadingShare<S> old = share;
    share.x = f * old.x;
    share.b = f * old.b;
    if (position) {
        share.x.p = moved_position(f, old.x);
        share.b.p = moved_position(f, old.b);
    }
    share.x = share.x + push.x;
    // In terms of the new heading the old one is less by what the bias has turned it.
    share.b = share.b + share.x * -length + push.b;
    propagate(pair, length);
    pair.xx = pair.xx + noise;
    take_news(share.x, share.b, add, noise, pair.xx - pair.xb * pair.xb / pair.bb, pair.xb / pair.bb);
    pair.xx = pair.xx + walk * length * length * length * S(1.0 / 3);
    pair.xb = pair.xb + S(0.5) * walk * length * length;
    pair.bb = pair.bb + walk * length;
    take_news(share.b, share.x, add, walk * length, pair.bb - pair.xb * pair.xb / pair.xx, pair.xb / pair.xx);
}

// What the velocity innovation z tells of the pair: psi gains Re(conj(x) z), the bias Re(conj(b) z). `seen` is the share of
// the pair in the velocity before; first the real part of z was taken, then the imaginary.
template <class S>
struct HeadingGain {
    Complex<S> seen_x, seen_b, x, b;
    PairGain<S> first, second;
};

// One real measurement of the pair through (hx, hb).
template <class S>
PairGain<S> measure(PairCovariance<S>& p, S hx, S hb, S variance) {
    const S px = p.xx * hx + p.xb * hb, pb = p.xb * hx + p.bb * hb, s = variance + hx * px + hb * pb, w = S(1) / s;
    p.xx = p.xx - px * px * w;
    p.xb = p.xb - px * pb * w;
    p.bb = p.bb - pb * pb * w;
    return {px * w, pb * w, s};
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
    return {x, b, {first.x - second.x * told, second.x}, {first.b - second.b * told, second.b}, first, second};
}

}  // namespace levelhead

#endif
