// One real measurement of the joint errors of the phasor filter, in any direction and of any mixture of them; and the
// vertical errors, three real numbers of their own. docs/theory/phasor.md
#ifndef LEVELHEAD_JOINT_HPP
#define LEVELHEAD_JOINT_HPP

#include "phasor_model.hpp"

namespace levelhead {

// The number Re(x^H e) + turn psi + bias beta_gz of the errors: what a measurement sees of them.
template <class S>
struct Row {
    PhasorVector<S> x;
    S turn, bias;
};

// Vertical velocity v, accelerometer bias b and, where positions are used, position d; all down.
template <class S>
struct LiftVector {
    S v, b, d;
};

template <class S>
LiftVector<S> operator+(const LiftVector<S>& x, const LiftVector<S>& y) { return {x.v + y.v, x.b + y.b, x.d + y.d}; }

// What is to be taken off the joint errors.
template <class S>
struct Correction {
    PhasorVector<S> x;
    S turn, bias;
    LiftVector<S> lift;
};

template <class S>
Correction<S> operator+(const Correction<S>& a, const Correction<S>& b) {
    return {a.x + b.x, a.turn + b.turn, a.bias + b.bias, a.lift + b.lift};
}

// What one measurement did: `gain` and `turn` times `error` was taken off the joint errors.
template <class S>
struct Observation {
    Row<S> row;
    PhasorVector<S> gain;
    PairGain<S> turn;
    S error;
    S left;  // 1 less what the row sees of the gain, without cancellation

    Correction<S> correction() const { return {gain * error, turn.x * error, turn.b * error, {}}; }
};

// P <- P - k k^H / 2s, C <- C - k k^T / 2s: k is the covariance with the real number measured, s its variance.
template <class S>
void take_off(PhasorCovariance<S>& p, PhasorDirection<S>& c, const PhasorVector<S>& k, S s) {
    add_seen(p, k, S(-1) / s);
    add_seen(c, k, S(-1) / s);
}

// Fold one real measurement of this error (estimate less truth) and variance into the covariances; nothing is approximate.
template <class S>
Observation<S> observe(PhasorCovariance<S>& p, PhasorDirection<S>& c, PairCovariance<S>& pair, HeadingShare<S>& share,
                       const Row<S>& row, S error, S variance) {
    const PhasorVector<S> k = against(p, c, row.x);
    const S seen = inner(row.x, k).re, s = variance + seen;
    const S hx = inner(row.x, share.x).re + row.turn, hb = inner(row.x, share.b).re + row.bias;
    take_off(p, c, k, s);
    const PairGain<S> told = measure(pair, hx, hb, s);
    // What the pair does not explain, the five take; then their shares are less by that.
    const PhasorVector<S> own = k * (S(1) / s);
    share.x = share.x + own * -hx;
    share.b = share.b + own * -hb;
    return {row, own + share.x * told.x + share.b * told.b, told, error, variance / told.variance};
}

// The same of the heading alone, which leaves the covariance of the five as it is.
template <class S>
Observation<S> observe_heading(PairCovariance<S>& pair, const HeadingShare<S>& share, S error, S variance) {
    Observation<S> o{};
    o.row.turn = S(1);
    o.turn = measure(pair, variance);
    o.gain = share.x * o.turn.x + share.b * o.turn.b;
    o.error = error;
    o.left = variance / o.turn.variance;
    return o;
}

// The innovation variance that such a measurement would have.
template <class S>
S expected(const PhasorCovariance<S>& p, const PhasorDirection<S>& c, const PairCovariance<S>& pair, const HeadingShare<S>& share,
           const Row<S>& row, S variance) {
    const S hx = inner(row.x, share.x).re + row.turn, hb = inner(row.x, share.b).re + row.bias;
    return variance + inner(row.x, against(p, c, row.x)).re + hx * (pair.xx * hx + pair.xb * hb) + hb * (pair.xb * hx + pair.bb * hb);
}

template <class S>
struct LiftCovariance {
    S vv, vb, bb, dd, dv, db;
};

template <class S>
LiftVector<S> times(const LiftCovariance<S>& p, const LiftVector<S>& x) {
    return {p.vv * x.v + p.vb * x.b + p.dv * x.d, p.vb * x.v + p.bb * x.b + p.db * x.d, p.dv * x.v + p.db * x.b + p.dd * x.d};
}

template <class S>
S inner(const LiftVector<S>& x, const LiftVector<S>& y) { return x.v * y.v + x.b * y.b + x.d * y.d; }

// Over a time T: d gathers v and b, v gathers b. Velocity or position that began anew keep nothing: 1 or 0.
template <class S>
struct LiftStep {
    S length, keep_v, keep_d;
};

template <class S>
void propagate_position(LiftCovariance<S>& p, S t, S noise, S walk) {
    const S t2 = t * t, t3 = t2 * t;
    p.dd = p.dd + S(2) * t * p.dv + t2 * (p.db + p.vv) + t3 * p.vb + S(0.25) * t2 * t2 * p.bb + noise * t3 * S(1.0 / 3) +
           walk * t3 * t2 * S(1.0 / 20);
    p.dv = p.dv + t * (p.db + p.vv) + S(1.5) * t2 * p.vb + S(0.5) * t3 * p.bb + S(0.5) * noise * t2 + walk * t2 * t2 * S(1.0 / 8);
    p.db = p.db + t * p.vb + S(0.5) * t2 * p.bb + walk * t3 * S(1.0 / 6);
}

template <class S>
void propagate(LiftCovariance<S>& p, S t, S noise, S walk, bool position) {
    const S t2 = t * t, t3 = t2 * t;
    if (position) propagate_position(p, t, noise, walk);
    p.vv = p.vv + S(2) * t * p.vb + t2 * p.bb + noise * t + walk * t3 * S(1.0 / 3);
    p.vb = p.vb + t * p.bb + S(0.5) * walk * t2;
    p.bb = p.bb + walk * t;
}

template <class S>
struct LiftObservation {
    LiftVector<S> row, gain;
    S variance, error;  // of the innovation; estimate less truth

    Correction<S> correction() const { return {{}, S(0), S(0), {gain.v * error, gain.b * error, gain.d * error}}; }
};

// One measurement of the state whose column of the covariance is k and whose variance is in it: `row` has a one there.
template <class S>
LiftObservation<S> observe(LiftCovariance<S>& p, const LiftVector<S>& row, const LiftVector<S>& k, S own, S error, S variance) {
    const S s = own + variance, w = S(1) / s;
    const LiftVector<S> gain = {k.v * w, k.b * w, k.d * w};
    p.vv = p.vv - k.v * gain.v;
    p.vb = p.vb - k.v * gain.b;
    p.bb = p.bb - k.b * gain.b;
    p.dd = p.dd - k.d * gain.d;
    p.dv = p.dv - k.d * gain.v;
    p.db = p.db - k.d * gain.b;
    return {row, gain, s, error};
}

template <class S>
LiftObservation<S> observe_velocity(LiftCovariance<S>& p, S error, S variance) {
    return observe(p, {S(1), S(0), S(0)}, LiftVector<S>{p.vv, p.vb, p.dv}, p.vv, error, variance);
}

template <class S>
LiftObservation<S> observe_position(LiftCovariance<S>& p, S error, S variance) {
    return observe(p, {S(0), S(0), S(1)}, LiftVector<S>{p.dv, p.db, p.dd}, p.dd, error, variance);
}

}  // namespace levelhead

#endif
