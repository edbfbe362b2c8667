// What the future says against the errors of the phasor filter: the adjoint and its variance, back through measurements and
// intervals. Everything is joint and exact: the five complex errors in both kinds of moments, heading and vertical gyro bias
// with them; the vertical apart, as in the filter.
#ifndef LEVELHEAD_ADJOINT_HPP
#define LEVELHEAD_ADJOINT_HPP

#include "joint.hpp"

namespace levelhead {

// The five, heading, vertical gyro bias.
template <class S>
struct Joint {
    PhasorVector<S> x;
    S turn, bias;
};

template <class S>
S inner(const Joint<S>& a, const Joint<S>& b) { return inner(a.x, b.x).re + a.turn * b.turn + a.bias * b.bias; }

// How the errors moved over an interval.
template <class S>
struct Step {
    Transition<S> moved;
    HeadingShare<S> push;  // of heading and vertical gyro bias on the five
    S length, keep;        // keep 1: the heading went on; 0: it began anew
    LiftStep<S> lift;
};

template <class S>
struct Adjoint {
    Joint<S> x;
    LiftVector<S> lift;
};

// A symmetric joint matrix: two moments of the five, two columns beside them, the corner; and the vertical's.
template <class S>
struct AdjointVariance {
    PhasorCovariance<S> level;
    PhasorDirection<S> direction;
    PhasorVector<S> turn, bias;
    PairCovariance<S> pair;
    LiftCovariance<S> lift;
};

template <class S>
Joint<S> times(const AdjointVariance<S>& m, const Joint<S>& w) {
    return {against(m.level, m.direction, w.x) + m.turn * w.turn + m.bias * w.bias,
            inner(m.turn, w.x).re + m.pair.xx * w.turn + m.pair.xb * w.bias,
            inner(m.bias, w.x).re + m.pair.xb * w.turn + m.pair.bb * w.bias};
}

// Both moments of x grow by those of a y + b y', that is by (a b^H + b a^H)/2 or (a b^T + b a^T)/2.
template <class S, class Kind>
void add_pair(PhasorMoments<S, Kind>& p, const PhasorVector<S>& a, const PhasorVector<S>& b) {
    const auto mixed = [](const Complex<S>& ai, const Complex<S>& bi, const Complex<S>& aj, const Complex<S>& bj) {
        return (ai * Kind::flip(bj) + bi * Kind::flip(aj)) * S(0.5);
    };
    p.nn = p.nn + Kind::diagonal(a.n, b.n);
    p.tt = p.tt + Kind::diagonal(a.t, b.t);
    p.gg = p.gg + Kind::diagonal(a.g, b.g);
    p.aa = p.aa + Kind::diagonal(a.a, b.a);
    p.pp = p.pp + Kind::diagonal(a.p, b.p);
    p.nt = p.nt + mixed(a.n, b.n, a.t, b.t);
    p.ng = p.ng + mixed(a.n, b.n, a.g, b.g);
    p.na = p.na + mixed(a.n, b.n, a.a, b.a);
    p.tg = p.tg + mixed(a.t, b.t, a.g, b.g);
    p.ta = p.ta + mixed(a.t, b.t, a.a, b.a);
    p.ga = p.ga + mixed(a.g, b.g, a.a, b.a);
    p.np = p.np + mixed(a.n, b.n, a.p, b.p);
    p.tp = p.tp + mixed(a.t, b.t, a.p, b.p);
    p.gp = p.gp + mixed(a.g, b.g, a.p, b.p);
    p.ap = p.ap + mixed(a.a, b.a, a.p, b.p);
}

// lambda <- (I - K H)^T lambda - H^T z / s.
template <class S>
void unobserve(Joint<S>& a, const Observation<S>& o) {
    const S seen = -(inner(o.gain, a.x).re + o.turn.x * a.turn + o.turn.b * a.bias) - o.error / o.turn.variance;
    a.x = a.x + o.row.x * seen;
    a.turn = a.turn + o.row.turn * seen;
    a.bias = a.bias + o.row.bias * seen;
}

template <class S>
bool sees_heading_alone(const Row<S>& row) {
    return row.turn == S(1) && row.bias == S(0) && norm2(row.x.n) + norm2(row.x.p) + norm2(row.x.g) == S(0);
}

// M <- (I - K H)^T M (I - K H) + H^T H / s.
template <class S>
void unobserve(AdjointVariance<S>& m, const Observation<S>& o) {
    const S w = S(1) / o.turn.variance;
    if (sees_heading_alone(o.row)) {
        // Only the heading's own row changes, and what is left of it is multiplied, not subtracted: the first course leaves a
        // millionth of a millionth.
        const Joint<S> rest = {o.gain * S(-1), o.left, -o.turn.b}, u = times(m, rest);
        m.turn = u.x;
        m.pair.xb = u.bias;
        m.pair.xx = inner(rest, u) + w;
        return;
    }
    const Joint<S> gain = {o.gain, o.turn.x, o.turn.b}, u = times(m, gain);
    const S c = S(0.5) * (inner(gain, u) + w);
    const Joint<S> b = {o.row.x * c + u.x * S(-1), o.row.turn * c - u.turn, o.row.bias * c - u.bias};
    add_pair(m.level, o.row.x, b.x);
    add_pair(m.direction, o.row.x, b.x);
    m.turn = m.turn + o.row.x * b.turn + b.x * o.row.turn;
    m.bias = m.bias + o.row.x * b.bias + b.x * o.row.bias;
    m.pair.xx = m.pair.xx + S(2) * o.row.turn * b.turn;
    m.pair.xb = m.pair.xb + o.row.turn * b.bias + o.row.bias * b.turn;
    m.pair.bb = m.pair.bb + S(2) * o.row.bias * b.bias;
}

template <class S>
void unobserve(LiftVector<S>& a, LiftCovariance<S>& m, const LiftObservation<S>& o) {
    const S w = S(1) / o.variance, seen = -inner(o.gain, a) - o.error * w;
    a = {a.v + o.row.v * seen, a.b + o.row.b * seen, a.d + o.row.d * seen};
    const LiftVector<S> u = times(m, o.gain);
    const S c = S(0.5) * (inner(o.gain, u) + w);
    const LiftVector<S>& h = o.row;
    const LiftVector<S> b = {h.v * c - u.v, h.b * c - u.b, h.d * c - u.d};
    m.vv = m.vv + S(2) * h.v * b.v;
    m.bb = m.bb + S(2) * h.b * b.b;
    m.dd = m.dd + S(2) * h.d * b.d;
    m.vb = m.vb + h.v * b.b + h.b * b.v;
    m.dv = m.dv + h.v * b.d + h.d * b.v;
    m.db = m.db + h.b * b.d + h.d * b.b;
}

// F^H x.
template <class S>
PhasorVector<S> transposed_times(const Transition<S>& f, const PhasorVector<S>& x) {
    return {conj(f.nn) * x.n + conj(f.pn) * x.p, conj(f.nt) * x.n + conj(f.tt) * x.t + conj(f.pt) * x.p,
            conj(f.ng) * x.n + conj(f.tg) * x.t + x.g + conj(f.pg) * x.p, conj(f.na) * x.n + conj(f.ta) * x.t + x.a + conj(f.pa) * x.p,
            conj(f.pp) * x.p};
}

template <class S>
void unmove(Adjoint<S>& a, const Step<S>& s) {
    const S from_heading = inner(s.push.x, a.x.x).re, from_bias = inner(s.push.b, a.x.x).re;
    a.x.bias = a.x.bias + s.keep * s.length * a.x.turn + from_bias;
    a.x.turn = s.keep * a.x.turn + from_heading;
    a.x.x = transposed_times(s.moved, a.x.x);
    const LiftStep<S>& l = s.lift;
    const LiftVector<S> old = a.lift;
    a.lift = {l.keep_v * old.v + l.keep_d * l.length * old.d,
              old.b + l.keep_v * l.length * old.v + S(0.5) * l.keep_d * l.length * l.length * old.d, l.keep_d * old.d};
}

// M <- F^H M F, or F^H N conj(F): the columns of F, seen by M, then by F^H.
template <class S, class Kind>
void unmove(PhasorMoments<S, Kind>& m, const Transition<S>& f) {
    const Complex<S> o = {S(0), S(0)}, one = {S(1), S(0)};
    const PhasorVector<S> columns[5] = {
        {f.nn, o, o, o, f.pn}, {f.nt, f.tt, o, o, f.pt}, {f.ng, f.tg, one, o, f.pg}, {f.na, f.ta, o, one, f.pa}, {o, o, o, o, f.pp}};
    PhasorVector<S> image[5];
    for (int j = 0; j < 5; ++j) image[j] = transposed_times(f, times(m, Kind::toward(columns[j])));
    const PhasorVector<S>&n = image[0], t = image[1], g = image[2], a = image[3], p = image[4];
    m.nn = Kind::template own<S>(n.n);
    m.tt = Kind::template own<S>(t.t);
    m.gg = Kind::template own<S>(g.g);
    m.aa = Kind::template own<S>(a.a);
    m.pp = Kind::template own<S>(p.p);
    m.nt = t.n;
    m.ng = g.n;
    m.na = a.n;
    m.tg = g.t;
    m.ta = a.t;
    m.ga = a.g;
    m.np = p.n;
    m.tp = p.t;
    m.gp = p.g;
    m.ap = p.a;
}

template <class S>
void unmove(LiftCovariance<S>& m, const LiftStep<S>& l) {
    const LiftVector<S> v = {l.keep_v, S(0), l.keep_d * l.length};
    const LiftVector<S> b = {l.keep_v * l.length, S(1), S(0.5) * l.keep_d * l.length * l.length}, d = {S(0), S(0), l.keep_d};
    const LiftVector<S> mv = times(m, v), mb = times(m, b), md = times(m, d);
    m = {inner(v, mv), inner(v, mb), inner(b, mb), inner(d, md), inner(d, mv), inner(d, mb)};
}

template <class S>
void unmove(AdjointVariance<S>& m, const Step<S>& s) {
    const HeadingShare<S>& d = s.push;
    const S keep = s.keep, drift = s.keep * s.length;
    const PhasorVector<S> turn = against(m.level, m.direction, d.x) + m.turn * keep;
    const PhasorVector<S> bias = against(m.level, m.direction, d.b) + m.turn * drift + m.bias;
    const S own = inner(d.x, m.turn).re, aside = inner(d.b, m.turn).re;
    const PairCovariance<S> p = m.pair;
    m.pair.xx = inner(d.x, turn).re + keep * own + keep * keep * p.xx;
    m.pair.xb = inner(d.x, bias).re + keep * aside + keep * (drift * p.xx + p.xb);
    m.pair.bb = inner(d.b, bias).re + drift * aside + inner(d.b, m.bias).re + drift * drift * p.xx + S(2) * drift * p.xb + p.bb;
    m.turn = transposed_times(s.moved, turn);
    m.bias = transposed_times(s.moved, bias);
    unmove(m.level, s.moved);
    unmove(m.direction, s.moved);
    unmove(m.lift, s.lift);
}

}  // namespace levelhead

#endif
