// The phasor smoother: the forward filter leaves one record per epoch, a backward pass over the records tells what the
// future knew about each of them (modified Bryson-Frazier: no matrix is inverted), and a last pass integrates the readings
// between the smoothed epochs. The caller owns all memory. docs/theory/phasor.md
#ifndef LEVELHEAD_SMOOTHER_HPP
#define LEVELHEAD_SMOOTHER_HPP

#include "phasor.hpp"

namespace levelhead {

template <class S>
struct PairStep {
    S keep;           // 1: the integral state went on over the interval; 0: it began anew
    S variance, error;  // of the innovation; variance 0: nothing was measured
    PairGain<S> gain;
    PairCovariance<S> covariance;  // afterwards
};

// The heading's part of a record besides.
template <class S>
struct HeadingStep {
    Complex<S> push;        // of a heading error on the velocity
    HeadingGain<S> told;    // by the velocity
    HeadingShare<S> share;  // of heading and vertical gyro bias in the four, afterwards
};

// What the forward filter did at one epoch: how the errors moved there, what was measured, and where it then stood.
template <class S>
struct SmootherRecord {
    double time;
    S length;
    bool fresh;  // the attitude began anew: it is no continuation of the record before
    bool heading_known;  // by then; after smoothing: ever, until the attitude begins anew
    Transition<S> moved;
    S variance;  // of the velocity innovation; 0: nothing was measured
    Complex<S> error;
    PhasorVector<S> gain;
    PhasorCovariance<S> covariance;
    PairStep<S> turning, lifting;
    HeadingStep<S> heading;
    // The filter's own state, which the backward pass replaces by the smoothed one.
    Dcm<S> dcm_body_to_ned;
    Vec3<S> velocity_ned, gyro_bias, accel_bias;
    Complex<S> azimuth;
    Sigma<S> sigma;  // smoothed
};

// Collects a record from the forward filter's calls; `Sink::push(record)` keeps it.
template <class S, class Sink>
struct Recording {
    Sink* sink;
    const double* clock;
    SmootherRecord<S> now;

    template <class Filter>
    void moved(const Filter&, const Transition<S>& f, const Complex<S>& push, S length, bool fresh) {
        now = SmootherRecord<S>{};
        now.moved = f;
        now.heading.push = push;
        now.length = length;
        now.fresh = fresh;
        now.turning.keep = fresh ? S(0) : S(1);
        now.lifting.keep = norm2(f.nn) > S(0) ? S(1) : S(0);
    }
    void corrected(const PhasorVector<S>& gain, const HeadingGain<S>& aside, S variance, const Complex<S>& error) {
        now.gain = gain;
        now.heading.told = aside;
        now.variance = variance;
        now.error = error;
    }
    void turned(const PairGain<S>& gain, S variance, S error) { measured(now.turning, gain, variance, error); }
    void lifted(const PairGain<S>& gain, S variance, S error) { measured(now.lifting, gain, variance, error); }
    template <class Filter>
    void done(const Filter& f) {
        now.time = *clock;
        now.covariance = f.horizontal;
        now.turning.covariance = f.turning;
        now.lifting.covariance = f.lifting;
        now.heading.share = f.share;
        now.dcm_body_to_ned = f.platform.dcm_body_to_ned;
        now.velocity_ned = f.platform.velocity_ned;
        now.gyro_bias = f.gyro_bias;
        now.accel_bias = f.accel_bias;
        now.azimuth = f.azimuth;
        now.heading_known = f.platform.heading_known > S(0.5);
        sink->push(now);
    }

  private:
    static void measured(PairStep<S>& step, const PairGain<S>& gain, S variance, S error) {
        step.gain = gain;
        step.variance = variance;
        step.error = error;
    }
};

// What the future says against the filter's errors (the adjoint lambda): of the four, of heading and vertical gyro bias, of
// vertical velocity and accelerometer bias.
template <class S>
struct Adjoint {
    PhasorVector<S> x;
    PairGain<S> turn, lift;
};

// Its variance M, as Hermitian as the covariance is; the coupling with the heading matters for the means only.
template <class S>
struct AdjointVariance {
    PhasorCovariance<S> level;
    PairCovariance<S> turn, lift;
};

template <class S>
PhasorVector<S> times(const PhasorCovariance<S>& p, const PhasorVector<S>& x) {
    return {x.n * p.nn + p.nt * x.t + p.ng * x.g + p.na * x.a,
            conj(p.nt) * x.n + x.t * p.tt + p.tg * x.g + p.ta * x.a,
            conj(p.ng) * x.n + conj(p.tg) * x.t + x.g * p.gg + p.ga * x.a,
            conj(p.na) * x.n + conj(p.ta) * x.t + conj(p.ga) * x.g + x.a * p.aa};
}

// Back through a measurement: M <- (I - K H)^H M (I - K H) + H^H H / s.
template <class S>
void unmeasure(PhasorCovariance<S>& m, const PhasorVector<S>& gain, S variance) {
    const PhasorVector<S> mk = times(m, gain);  // the gain's image; K^H M is its conjugate
    const S w = S(1) / variance;
    m.nn = m.nn - S(2) * mk.n.re + inner(gain, mk).re + w;
    m.nt = m.nt - conj(mk.t);
    m.ng = m.ng - conj(mk.g);
    m.na = m.na - conj(mk.a);
}

// F^H lambda.
template <class S>
PhasorVector<S> transposed_times(const Transition<S>& f, const PhasorVector<S>& x) {
    return {conj(f.nn) * x.n, conj(f.nt) * x.n + conj(f.tt) * x.t, conj(f.ng) * x.n + conj(f.tg) * x.t + x.g,
            conj(f.na) * x.n + conj(f.ta) * x.t + x.a};
}

// Back through an interval: M <- F^H M F.
template <class S>
void unmove(PhasorCovariance<S>& out, const Transition<S>& f) {
    const PhasorCovariance<S> m = out;
    const Complex<S> gn = conj(m.ng), gt = conj(m.tg), an = conj(m.na), at = conj(m.ta);
    // Rows n, t of M F (columns t, g, a), and M F's rows g, a where they are needed.
    const Complex<S> nt = f.nt * m.nn + m.nt * f.tt, tt = conj(m.nt) * f.nt + f.tt * m.tt;
    const Complex<S> ng = f.ng * m.nn + m.nt * f.tg + m.ng, tg = conj(m.nt) * f.ng + f.tg * m.tt + m.tg;
    const Complex<S> na = f.na * m.nn + m.nt * f.ta + m.na, ta = conj(m.nt) * f.na + f.ta * m.tt + m.ta;
    const Complex<S> gg = gn * f.ng + gt * f.tg + Complex<S>{m.gg, S(0)};
    const Complex<S> ga = gn * f.na + gt * f.ta + m.ga;
    const Complex<S> aa = an * f.na + at * f.ta + Complex<S>{m.aa, S(0)};
    out.nn = norm2(f.nn) * m.nn;
    out.nt = conj(f.nn) * nt;
    out.ng = conj(f.nn) * ng;
    out.na = conj(f.nn) * na;
    out.tt = inner(nt, f.nt) + inner(tt, f.tt);
    out.tg = conj(f.nt) * ng + conj(f.tt) * tg;
    out.ta = conj(f.nt) * na + conj(f.tt) * ta;
    out.gg = (conj(f.ng) * ng + conj(f.tg) * tg + gg).re;
    out.ga = conj(f.ng) * na + conj(f.tg) * ta + ga;
    out.aa = (conj(f.na) * na + conj(f.ta) * ta + aa).re;
}

// The smoothed variance of one component: P_ii - (P M P)_ii.
template <class S>
S smoothed_variance(const PhasorCovariance<S>& p, const PhasorCovariance<S>& m, const PhasorVector<S>& unit, S own) {
    const PhasorVector<S> column = times(p, unit);
    return maximum(own - inner(column, times(m, column)).re, S(0));
}

// Likewise for a pair. `left` is multiplied, not subtracted later: the first course leaves a millionth of a millionth.
template <class S>
void unmeasure(PairCovariance<S>& m, const PairGain<S>& k, S variance) {
    const S left = S(1) - k.x;
    m.xx = left * left * m.xx - S(2) * left * k.b * m.xb + k.b * k.b * m.bb + S(1) / variance;
    m.xb = left * m.xb - k.b * m.bb;
}

template <class S>
void unmove(PairCovariance<S>& m, S keep, S length) {
    const S g = keep * length;
    m.bb = m.bb + S(2) * g * m.xb + g * g * m.xx;
    m.xb = keep * (m.xb + g * m.xx);
    m.xx = keep * keep * m.xx;
}

// Back through what the velocity told the pair, two real measurements H with one noise: M <- (I - K H)^T M (I - K H) + H^T H
// (I - K H) / s, where the inverse innovation variance is (I - H K) / s.
template <class S>
void unmeasure(PairCovariance<S>& m, const HeadingGain<S>& k, S variance) {
    const S xx = S(1) - inner(k.x, k.seen_x), xb = -inner(k.x, k.seen_b), bx = -inner(k.b, k.seen_x), bb = S(1) - inner(k.b, k.seen_b);
    const S w = S(1) / variance, hxx = norm2(k.seen_x) * w, hxb = inner(k.seen_x, k.seen_b) * w, hbb = norm2(k.seen_b) * w;
    const PairCovariance<S> old = m;
    m.xx = xx * xx * old.xx + S(2) * xx * bx * old.xb + bx * bx * old.bb + hxx * xx + hxb * bx;
    m.xb = xx * xb * old.xx + (xx * bb + bx * xb) * old.xb + bx * bb * old.bb + hxx * xb + hxb * bb;
    m.bb = xb * xb * old.xx + S(2) * xb * bb * old.xb + bb * bb * old.bb + hxb * xb + hbb * bb;
}

// The smoothed covariance of a pair: P - P M P.
template <class S>
PairCovariance<S> smoothed(const PairCovariance<S>& p, const PairCovariance<S>& m) {
    const S xx = p.xx * m.xx + p.xb * m.xb, xb = p.xx * m.xb + p.xb * m.bb, bx = p.xb * m.xx + p.bb * m.xb, bb = p.xb * m.xb + p.bb * m.bb;
    return {maximum(p.xx - xx * p.xx - xb * p.xb, S(0)), p.xb - xx * p.xb - xb * p.bb, maximum(p.bb - bx * p.xb - bb * p.bb, S(0))};
}

// The adjoint of the pair, with what reaches it through its share of the four.
template <class S>
PairGain<S> with_share(const Adjoint<S>& a, const HeadingShare<S>& share) {
    return {a.turn.x + inner(share.x, a.x).re, a.turn.b + inner(share.b, a.x).re};
}

// Lambda back over one record: through its measurements in reverse order, then through the interval before it.
template <class S>
void step_back(Adjoint<S>& a, const SmootherRecord<S>& r) {
    const HeadingStep<S>& h = r.heading;
    // A turn of the platform takes the heading's share of the four with it.
    if (r.turning.variance > S(0)) {
        const PairGain<S>&k = r.turning.gain, against = with_share(a, h.share);
        a.turn.x = a.turn.x - (k.x * against.x + k.b * against.b) - r.turning.error / r.turning.variance;
    }
    if (r.variance > S(0)) {
        const HeadingGain<S>& k = h.told;
        const PairGain<S> against = with_share(a, h.share);
        const Complex<S> explained = k.seen_x * inner(k.x, r.error) + k.seen_b * inner(k.b, r.error);
        a.x.n = a.x.n - inner(r.gain, a.x) - k.x * against.x - k.b * against.b - (r.error - explained) * (S(1) / r.variance);
    }
    if (r.lifting.variance > S(0)) {
        const PairGain<S>& k = r.lifting.gain;
        a.lift.x = a.lift.x - (k.x * a.lift.x + k.b * a.lift.b) - r.lifting.error / r.lifting.variance;
    }
    const S pushed = inner(h.push, a.x.n), keep = r.turning.keep;
    a.turn.b = a.turn.b + keep * r.length * a.turn.x + S(0.5) * r.length * pushed;
    a.turn.x = keep * a.turn.x + pushed;
    a.lift.b = a.lift.b + r.lifting.keep * r.length * a.lift.x;
    a.lift.x = r.lifting.keep * a.lift.x;
    a.x = transposed_times(r.moved, a.x);
}

// Its variance likewise.
template <class S>
void step_back(AdjointVariance<S>& m, const SmootherRecord<S>& r) {
    if (r.turning.variance > S(0)) unmeasure(m.turn, r.turning.gain, r.turning.variance);
    if (r.variance > S(0)) {
        unmeasure(m.level, r.gain, r.variance);
        unmeasure(m.turn, r.heading.told, r.variance);
    }
    if (r.lifting.variance > S(0)) unmeasure(m.lift, r.lifting.gain, r.lifting.variance);
    unmove(m.turn, r.turning.keep, r.length);
    unmove(m.lift, r.lifting.keep, r.length);
    unmove(m.level, r.moved);
}

// The smoothed state of one record: the filter's, less P lambda of everything.
template <class S>
void replace_by_smoothed(SmootherRecord<S>& r, const Adjoint<S>& a, const AdjointVariance<S>& m, S gravity_var) {
    const HeadingShare<S>& share = r.heading.share;
    const PairCovariance<S>&t = r.turning.covariance, &l = r.lifting.covariance;
    const PairGain<S> against = with_share(a, share);
    const S turn = t.xx * against.x + t.xb * against.b, turn_bias = t.xb * against.x + t.bb * against.b;
    const PhasorVector<S> d = times(r.covariance, a.x) + share.x * turn + share.b * turn_bias;
    const S lift = l.xx * a.lift.x + l.xb * a.lift.b, lift_bias = l.xb * a.lift.x + l.bb * a.lift.b;

    const Complex<S> nu = r.azimuth * d.n, theta = r.azimuth * d.t, g = r.azimuth * d.g, b = r.azimuth * d.a;
    r.gyro_bias = r.gyro_bias - transposed_times(r.dcm_body_to_ned, {g.re, g.im, turn_bias});
    r.accel_bias = r.accel_bias - transposed_times(r.dcm_body_to_ned, {b.re, b.im, lift_bias});
    r.velocity_ned = r.velocity_ned + Vec3<S>{nu.re, nu.im, lift};
    // The heading may be off by any angle (before the first course), the tilt never is: two rotations, not one.
    r.dcm_body_to_ned = turned_about_vertical(rotated_in_ned(r.dcm_body_to_ned, {theta.re, theta.im, S(0)}), turn);

    const Complex<S> zero = {S(0), S(0)}, one = {S(1), S(0)};
    const S tilt = smoothed_variance(r.covariance, m.level, {zero, one, zero, zero}, r.covariance.tt);
    const S gyro = smoothed_variance(r.covariance, m.level, {zero, zero, one, zero}, r.covariance.gg);
    const S accel = smoothed_variance(r.covariance, m.level, {zero, zero, zero, one}, r.covariance.aa);
    const PairCovariance<S> left = smoothed(t, m.turn);
    r.sigma = level_sigma(r.dcm_body_to_ned.z, gyro + shared_variance(left, share.x.g, share.b.g), left.bb,
                          accel + shared_variance(left, share.x.a, share.b.a), smoothed(l, m.lift).bb + gravity_var,
                          tilt + shared_variance(left, share.x.t, share.b.t), r.heading_known ? left.xx : S(pi * pi));
}

// Replace the filter's state in each record by the smoothed one. Records in time order; `gravity_var` as in the filter.
template <class S>
void smooth(SmootherRecord<S>* records, long count, S gravity_var) {
    Adjoint<S> a{};
    AdjointVariance<S> m{};
    for (long k = count - 1; k >= 0; --k) {
        if (k + 1 < count && !records[k + 1].fresh && records[k + 1].heading_known) records[k].heading_known = true;
        replace_by_smoothed(records[k], a, m, gravity_var);
        step_back(a, records[k]);
        step_back(m, records[k]);
    }
}

}  // namespace levelhead

#endif
