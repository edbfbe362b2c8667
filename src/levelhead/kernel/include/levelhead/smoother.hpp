// The phasor smoother: the forward filter leaves one record per epoch and what each measurement did, a backward pass tells
// what the future knew about each of them (modified Bryson-Frazier: no matrix is inverted), and a last pass integrates the
// readings between the smoothed epochs. The caller owns all memory. docs/theory/phasor.md
#ifndef LEVELHEAD_SMOOTHER_HPP
#define LEVELHEAD_SMOOTHER_HPP

#include "adjoint.hpp"
#include "phasor.hpp"

namespace levelhead {

// What the forward filter did at one epoch: how the errors moved there, which measurements followed (rows of two lists of the
// tape), and where it then stood.
template <class S>
struct SmootherRecord {
    double time;
    bool fresh;  // the attitude began anew: it is no continuation of the record before
    bool heading_known;  // by then; after smoothing: ever, until the attitude begins anew
    bool tracked;        // the position was estimated
    Step<S> step;
    long first, count, first_lift, lifts;
    PhasorCovariance<S> covariance;
    PhasorDirection<S> direction;
    PairCovariance<S> turning;
    HeadingShare<S> share;
    LiftCovariance<S> lifting;
    // The filter's own state, which the backward pass replaces by the smoothed one.
    Dcm<S> dcm_body_to_ned;
    Vec3<S> velocity_ned, gyro_bias, accel_bias;
    Geodetic place;
    Complex<S> azimuth;
    S gravity, latitude, unseen_rate2;
    Sigma<S> sigma;  // smoothed
};

// Collects a record from the forward filter's calls. `Sink` keeps records, observations and lifts: push(...), and how many of
// the latter two there are: observed(), lifted().
template <class S, class Sink>
struct Recording {
    static constexpr bool listening = true;
    Sink* sink;
    const double* clock;
    SmootherRecord<S> now;

    template <class Filter>
    void moved(const Filter&, const Transition<S>& f, const HeadingShare<S>& push, S length, S keep, const LiftStep<S>& lift) {
        now = SmootherRecord<S>{};
        now.step = {f, push, length, keep, lift};
        now.fresh = !(keep > S(0));
        now.first = sink->observed();
        now.first_lift = sink->lifted();
    }
    void observed(const Observation<S>& o) { sink->push(o); }
    void lifted(const LiftObservation<S>& o) { sink->push(o); }
    template <class Filter>
    void done(const Filter& f) {
        now.time = *clock;
        now.count = sink->observed() - now.first;
        now.lifts = sink->lifted() - now.first_lift;
        now.covariance = f.horizontal;
        now.direction = f.direction;
        now.turning = f.turning;
        now.share = f.share;
        now.lifting = f.lifting;
        now.dcm_body_to_ned = f.platform.dcm_body_to_ned;
        now.velocity_ned = f.platform.velocity_ned;
        now.gyro_bias = f.gyro_bias;
        now.accel_bias = f.accel_bias;
        now.azimuth = f.azimuth;
        now.heading_known = f.platform.heading_known > S(0.5);
        now.tracked = f.tracked > S(0.5);
        now.place = f.place;
        now.gravity = f.gravity;
        now.latitude = f.latitude_felt;
        now.unseen_rate2 = f.unseen_rate2;
        sink->push(now);
    }
};

// All that a forward run has left behind, in the order of time.
template <class S>
struct Tape {
    SmootherRecord<S>* records;
    long count;
    const Observation<S>* observations;
    const LiftObservation<S>* lifts;
};

// The joint covariance of a record times a joint vector.
template <class S>
Joint<S> times(const SmootherRecord<S>& r, const PhasorVector<S>& x, S turn, S bias) {
    const S psi = turn + inner(r.share.x, x).re, beta = bias + inner(r.share.b, x).re;
    const S own = r.turning.xx * psi + r.turning.xb * beta, drift = r.turning.xb * psi + r.turning.bb * beta;
    return {against(r.covariance, r.direction, x) + r.share.x * own + r.share.b * drift, own, drift};
}

// The smoothed variance of the real number that this functional makes of the errors: P - P M P.
template <class S>
S smoothed_variance(const SmootherRecord<S>& r, const AdjointVariance<S>& m, const PhasorVector<S>& x, S turn, S bias) {
    const Joint<S> w = times(r, x, turn, bias);
    return maximum(inner(x, w.x).re + turn * w.turn + bias * w.bias - inner(w, times(m, w)), S(0));
}

template <class S>
Sigma<S> smoothed_sigma(const SmootherRecord<S>& r, const AdjointVariance<S>& m, S gravity_var) {
    const S none = S(0), half = S(0.5), unknown = S(NAN);
    const Complex<S> one = {S(1), none}, i = {none, S(1)}, north = conj(r.azimuth), east = times_i(north);
    const auto at = [](const Complex<S>& n, const Complex<S>& t, const Complex<S>& g, const Complex<S>& a, const Complex<S>& p) {
        return PhasorVector<S>{n, t, g, a, p};
    };
    const Complex<S> o = {none, none};
    const auto variance = [&](const PhasorVector<S>& x) { return smoothed_variance(r, m, x, none, none); };
    const S tilt = half * (variance(at(o, one, o, o, o)) + variance(at(o, i, o, o, o)));
    const S gyro = half * (variance(at(o, o, one, o, o)) + variance(at(o, o, i, o, o)));
    const S accel = half * (variance(at(o, o, o, one, o)) + variance(at(o, o, o, i, o)));
    const S turn = smoothed_variance(r, m, PhasorVector<S>{}, S(1), none), drift = smoothed_variance(r, m, PhasorVector<S>{}, none, S(1));
    const auto lift = [&](const LiftVector<S>& x) {
        const LiftVector<S> w = times(r.lifting, x);
        return maximum(inner(x, w) - inner(w, times(m.lift, w)), none);
    };
    Sigma<S> out = level_sigma(r.dcm_body_to_ned.z, gyro + r.unseen_rate2, drift, accel, lift({none, S(1), none}) + gravity_var, tilt,
                               r.heading_known ? turn : S(pi * pi));
    out.velocity = {square_root(variance(at(north, o, o, o, o))), square_root(variance(at(east, o, o, o, o))),
                    square_root(lift({S(1), none, none}))};
    out.position = {unknown, unknown, unknown};
    if (r.tracked)
        out.position = {square_root(variance(at(o, o, o, o, north))), square_root(variance(at(o, o, o, o, east))),
                        square_root(lift({none, none, S(1)}))};
    return out;
}

// The smoothed state of one record: the filter's, less P lambda of everything.
template <class S>
void replace_by_smoothed(SmootherRecord<S>& r, const Adjoint<S>& a) {
    const Joint<S> d = times(r, a.x.x, a.x.turn, a.x.bias);
    const LiftVector<S> lift = times(r.lifting, a.lift);
    const Complex<S> nu = r.azimuth * d.x.n, theta = r.azimuth * d.x.t, g = r.azimuth * d.x.g, b = r.azimuth * d.x.a, way = r.azimuth * d.x.p;
    r.gyro_bias = r.gyro_bias - transposed_times(r.dcm_body_to_ned, {g.re, g.im, d.bias});
    r.accel_bias = r.accel_bias - transposed_times(r.dcm_body_to_ned, {b.re, b.im, lift.b});
    r.velocity_ned = r.velocity_ned + Vec3<S>{nu.re, nu.im, lift.v};
    if (r.tracked) r.place = moved(r.place, widened(Vec3<S>{way.re, way.im, lift.d}));
    // The heading may be off by any angle (before the first course), the tilt never is: two rotations, not one.
    r.dcm_body_to_ned = turned_about_vertical(rotated_in_ned(r.dcm_body_to_ned, {theta.re, theta.im, S(0)}), d.turn);
}

// How often a new sigma is worth its while, s: it hardly changes between epochs that are closer together, but near the ends.
constexpr double sigma_every = 0.45, sigma_ends = 20.0;

// Replace the filter's state in each record by the smoothed one; `gravity_var` as in the filter.
template <class S>
void smooth(const Tape<S>& tape, S gravity_var) {
    Adjoint<S> a{};
    AdjointVariance<S> m{};
    const SmootherRecord<S>* shown = nullptr;
    const double first = tape.count > 0 ? tape.records[0].time : 0.0, last = tape.count > 0 ? tape.records[tape.count - 1].time : 0.0;
    for (long k = tape.count - 1; k >= 0; --k) {
        SmootherRecord<S>& r = tape.records[k];
        if (k + 1 < tape.count && !tape.records[k + 1].fresh && tape.records[k + 1].heading_known) r.heading_known = true;
        replace_by_smoothed(r, a);  // first: sigma in body axes is that of the smoothed attitude
        const bool same = shown != nullptr && shown->time - r.time < sigma_every && shown->tracked == r.tracked &&
                          shown->heading_known == r.heading_known && r.time > first + sigma_ends && r.time < last - sigma_ends && !shown->fresh;
        r.sigma = same ? shown->sigma : smoothed_sigma(r, m, gravity_var);
        if (!same) shown = &r;
        for (long j = r.first + r.count - 1; j >= r.first; --j) {
            unobserve(a.x, tape.observations[j]);
            unobserve(m, tape.observations[j]);
        }
        for (long j = r.first_lift + r.lifts - 1; j >= r.first_lift; --j) unobserve(a.lift, m.lift, tape.lifts[j]);
        unmove(a, r.step);
        unmove(m, r.step);
    }
}

}  // namespace levelhead

#endif
