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

// What the forward filter did at one epoch: how the errors moved there, what was measured, and where it then stood.
template <class S>
struct SmootherRecord {
    double time;
    S length;
    bool fresh;  // the attitude began anew: it is no continuation of the record before
    Transition<S> moved;
    S variance;  // of the velocity innovation; 0: nothing was measured
    Complex<S> error;
    PhasorVector<S> gain;
    PhasorCovariance<S> covariance;
    PairStep<S> turning, lifting;
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
    void moved(const Filter&, const Transition<S>& f, S length, bool fresh) {
        now = SmootherRecord<S>{};
        now.moved = f;
        now.length = length;
        now.fresh = fresh;
        now.turning.keep = fresh ? S(0) : S(1);
        now.lifting.keep = norm2(f.nn) > S(0) ? S(1) : S(0);
    }
    void corrected(const PhasorVector<S>& gain, S variance, const Complex<S>& error) {
        now.gain = gain;
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
        now.dcm_body_to_ned = f.platform.dcm_body_to_ned;
        now.velocity_ned = f.platform.velocity_ned;
        now.gyro_bias = f.gyro_bias;
        now.accel_bias = f.accel_bias;
        now.azimuth = f.azimuth;
        sink->push(now);
    }

  private:
    static void measured(PairStep<S>& step, const PairGain<S>& gain, S variance, S error) {
        step.gain = gain;
        step.variance = variance;
        step.error = error;
    }
};

// The adjoint of the four complex errors: lambda, and its variance (as Hermitian as the covariance is).
template <class S>
struct PhasorAdjoint {
    PhasorVector<S> x;
    PhasorCovariance<S> m;
};

template <class S>
PhasorVector<S> times(const PhasorCovariance<S>& p, const PhasorVector<S>& x) {
    return {x.n * p.nn + p.nt * x.t + p.ng * x.g + p.na * x.a,
            conj(p.nt) * x.n + x.t * p.tt + p.tg * x.g + p.ta * x.a,
            conj(p.ng) * x.n + conj(p.tg) * x.t + x.g * p.gg + p.ga * x.a,
            conj(p.na) * x.n + conj(p.ta) * x.t + conj(p.ga) * x.g + x.a * p.aa};
}

// x^H y.
template <class S>
Complex<S> inner(const PhasorVector<S>& x, const PhasorVector<S>& y) {
    return conj(x.n) * y.n + conj(x.t) * y.t + conj(x.g) * y.g + conj(x.a) * y.a;
}

// Back through a measurement: lambda <- (I - K H)^H lambda - H^H z / s, and its variance likewise.
template <class S>
void unmeasure(PhasorAdjoint<S>& a, const PhasorVector<S>& gain, S variance, const Complex<S>& error) {
    PhasorCovariance<S>& m = a.m;
    const PhasorVector<S> mk = times(m, gain);  // the gain's image; K^H M is its conjugate
    const S w = S(1) / variance;
    a.x.n = a.x.n - inner(gain, a.x) - error * w;
    m.nn = m.nn - S(2) * mk.n.re + inner(gain, mk).re + w;
    m.nt = m.nt - conj(mk.t);
    m.ng = m.ng - conj(mk.g);
    m.na = m.na - conj(mk.a);
}

// Back through an interval: lambda <- F^H lambda, M <- F^H M F.
template <class S>
void unmove(PhasorAdjoint<S>& a, const Transition<S>& f) {
    const PhasorVector<S> x = a.x;
    a.x = {conj(f.nn) * x.n, conj(f.nt) * x.n + conj(f.tt) * x.t, conj(f.ng) * x.n + conj(f.tg) * x.t + x.g,
           conj(f.na) * x.n + conj(f.ta) * x.t + x.a};
    const PhasorCovariance<S> m = a.m;
    const Complex<S> gn = conj(m.ng), gt = conj(m.tg), an = conj(m.na), at = conj(m.ta);
    // Rows n, t of M F (columns t, g, a), and M F's rows g, a where they are needed.
    const Complex<S> nt = f.nt * m.nn + m.nt * f.tt, tt = conj(m.nt) * f.nt + f.tt * m.tt;
    const Complex<S> ng = f.ng * m.nn + m.nt * f.tg + m.ng, tg = conj(m.nt) * f.ng + f.tg * m.tt + m.tg;
    const Complex<S> na = f.na * m.nn + m.nt * f.ta + m.na, ta = conj(m.nt) * f.na + f.ta * m.tt + m.ta;
    const Complex<S> gg = gn * f.ng + gt * f.tg + Complex<S>{m.gg, S(0)};
    const Complex<S> ga = gn * f.na + gt * f.ta + m.ga;
    const Complex<S> aa = an * f.na + at * f.ta + Complex<S>{m.aa, S(0)};
    a.m.nn = norm2(f.nn) * m.nn;
    a.m.nt = conj(f.nn) * nt;
    a.m.ng = conj(f.nn) * ng;
    a.m.na = conj(f.nn) * na;
    a.m.tt = inner(nt, f.nt) + inner(tt, f.tt);
    a.m.tg = conj(f.nt) * ng + conj(f.tt) * tg;
    a.m.ta = conj(f.nt) * na + conj(f.tt) * ta;
    a.m.gg = (conj(f.ng) * ng + conj(f.tg) * tg + gg).re;
    a.m.ga = conj(f.ng) * na + conj(f.tg) * ta + ga;
    a.m.aa = (conj(f.na) * na + conj(f.ta) * ta + aa).re;
}

// The smoothed variance of one component: P_ii - (P M P)_ii.
template <class S>
S smoothed_variance(const PhasorCovariance<S>& p, const PhasorCovariance<S>& m, const PhasorVector<S>& unit, S own) {
    const PhasorVector<S> column = times(p, unit);
    return maximum(own - inner(column, times(m, column)).re, S(0));
}

template <class S>
struct PairAdjoint {
    S x, b;             // lambda
    S xx, xb, bb;       // its variance
};

template <class S>
void unmeasure(PairAdjoint<S>& a, const PairStep<S>& step) {
    if (!(step.variance > S(0))) return;
    const PairGain<S>& k = step.gain;
    const S w = S(1) / step.variance;
    const S mx = a.xx * k.x + a.xb * k.b, mb = a.xb * k.x + a.bb * k.b;
    a.x = a.x - (k.x * a.x + k.b * a.b) - step.error * w;
    a.xx = a.xx - S(2) * mx + k.x * mx + k.b * mb + w;
    a.xb = a.xb - mb;
}

template <class S>
void unmove(PairAdjoint<S>& a, const PairStep<S>& step, S length) {
    const S f = step.keep, g = step.keep * length;
    a.b = a.b + g * a.x;
    a.x = f * a.x;
    a.bb = a.bb + S(2) * g * a.xb + g * g * a.xx;
    a.xb = f * (a.xb + g * a.xx);
    a.xx = f * f * a.xx;
}

template <class S>
struct PairSmoothed {
    S x, b, x_variance, b_variance;
};

template <class S>
PairSmoothed<S> smoothed(const PairCovariance<S>& p, const PairAdjoint<S>& a) {
    const auto left = [&](S px, S pb, S own) {
        return maximum(own - (px * px * a.xx + S(2) * px * pb * a.xb + pb * pb * a.bb), S(0));
    };
    return {-(p.xx * a.x + p.xb * a.b), -(p.xb * a.x + p.bb * a.b), left(p.xx, p.xb, p.xx), left(p.xb, p.bb, p.bb)};
}

// Replace the filter's state in each record by the smoothed one. Records in time order; `gravity_var` as in the filter.
template <class S>
void smooth(SmootherRecord<S>* records, long count, S gravity_var) {
    PhasorAdjoint<S> a{};
    PairAdjoint<S> turning{}, lifting{};
    const Complex<S> zero = {S(0), S(0)}, one = {S(1), S(0)};
    for (long k = count - 1; k >= 0; --k) {
        SmootherRecord<S>& r = records[k];
        const PhasorVector<S> d = times(r.covariance, a.x);  // minus what is to be taken off
        const PairSmoothed<S> turn = smoothed(r.turning.covariance, turning), lift = smoothed(r.lifting.covariance, lifting);
        const S tilt = smoothed_variance(r.covariance, a.m, {zero, one, zero, zero}, r.covariance.tt);
        const S gyro = smoothed_variance(r.covariance, a.m, {zero, zero, one, zero}, r.covariance.gg);
        const S accel = smoothed_variance(r.covariance, a.m, {zero, zero, zero, one}, r.covariance.aa);
        const Complex<S> nu = r.azimuth * d.n, theta = r.azimuth * d.t, g = r.azimuth * d.g, b = r.azimuth * d.a;
        r.gyro_bias = r.gyro_bias + transposed_times(r.dcm_body_to_ned, {-g.re, -g.im, turn.b});
        r.accel_bias = r.accel_bias + transposed_times(r.dcm_body_to_ned, {-b.re, -b.im, lift.b});
        r.velocity_ned = r.velocity_ned + Vec3<S>{nu.re, nu.im, -lift.x};
        // The heading may be off by any angle (before the first course), the tilt never is: two rotations, not one.
        r.dcm_body_to_ned = turned_about_vertical(rotated_in_ned(r.dcm_body_to_ned, {theta.re, theta.im, S(0)}), -turn.x);
        r.sigma = level_sigma(r.dcm_body_to_ned.z, gyro, turn.b_variance, accel, lift.b_variance + gravity_var, tilt, turn.x_variance);

        if (r.variance > S(0)) unmeasure(a, r.gain, r.variance, r.error);
        unmove(a, r.moved);
        unmeasure(turning, r.turning);
        unmove(turning, r.turning, r.length);
        unmeasure(lifting, r.lifting);
        unmove(lifting, r.lifting, r.length);
    }
}

}  // namespace levelhead

#endif
