// A stream of readings: time stamps (always double), trapezoids between IMU samples, GNSS epochs that fall between two
// samples, gaps. Batch runs feed the same two functions, so both are one code path.
#ifndef LEVELHEAD_STREAM_HPP
#define LEVELHEAD_STREAM_HPP

#include "platform.hpp"
#include "status.hpp"

namespace levelhead {

constexpr double bridge_gap = 0.2;  // a longer time between IMU samples is bridged, and nothing is learnt across it, s
constexpr double reset_gap = 2.0;   // a still longer one loses the attitude: level anew, keep the biases, s
constexpr double coast_after = 2.5; // GNSS counts as absent after this many of its last intervals
constexpr double no_time = -1e300;

template <class Estimator>
struct Stream {
    using S = typename Estimator::Scalar;

    typename Estimator::Params params;
    Estimator estimator;
    double time;          // of the last IMU sample
    double epoch_time;    // at which the current interval begins
    double gnss_time;     // of the last epoch taken
    double pending_time;  // of an epoch that lies ahead of the last IMU sample
    double advanced_to;   // the estimator's state belongs to this time
    double last_length;   // of the last closed interval
    Vec3<S> gyro, accel;  // the last sample
    Fix<S> pending;
    uint32_t broken;      // an IMU gap lies in the current interval
    uint32_t settled;     // status bits that only change at epochs
    Interval<S> interval; // the last one closed
    uint32_t closed;      // how many there have been
    EventCounter events[EVENT_COUNT];
    S jumps;              // that the estimator's position had made
    S resting;            // the last sample was at rest: 1, else 0

    static Stream make(const typename Estimator::Params& params, const Vec3<S>& gyro_bias, const Vec3<S>& accel_bias) {
        Stream s{};
        s.params = params;
        s.estimator.gyro_bias = gyro_bias;
        s.estimator.accel_bias = accel_bias;
        s.estimator.begin(params);
        s.time = s.epoch_time = s.gnss_time = s.pending_time = s.advanced_to = no_time;
        s.settled = s.estimator.settled();
        return s;
    }

    bool started() const { return time > no_time; }

    // One IMU sample; false when it was dropped (out of order or not finite).
    bool imu(double t, const Vec3<S>& w, const Vec3<S>& f) {
        if (!finite(t) || !finite(w) || !finite(f)) return drop(E_NONFINITE, stamp(t));
        if (!started()) {
            estimator.restart(params, f - estimator.accel_bias, S(0));
            return take(t, w, f);
        }
        if (!(t > time)) return drop(W_TIME_BACK, t);
        if (t - time > reset_gap) {
            note(events[E_GAP_RESET], t);
            estimator.restart(params, f - estimator.accel_bias, S(t - time));
            epoch_time = pending_time = no_time;
            broken = 0;
            return take(t, w, f);
        }
        const bool gap = t - time > bridge_gap;
        if (gap) {
            note(events[W_GAP], t);
            broken = 1;
            estimator.bridged(S(t - time), w - gyro, f - accel);
        }
        const Vec3<S> mean_gyro = (gyro + w) * S(0.5), mean_accel = (accel + f) * S(0.5);
        if (pending_time > no_time && pending_time <= t) {
            advance_to(pending_time, mean_gyro, mean_accel);
            const bool rest = gap && pending_time < t;  // of the gap lies in the next interval
            close();
            broken = rest;
        }
        advance_to(t, mean_gyro, mean_accel);
        return take(t, w, f);
    }

    // One GNSS epoch; false when it was dropped. It may lie ahead of the last IMU sample, never behind it. Velocity or position
    // may be absent (NaN), and is for an estimator that has no use for it.
    bool gnss(double t, const Vec3<S>& velocity, const Vec3<S>& velocity_std, const Geodetic& position, const Vec3<S>& position_std) {
        const bool has_velocity = finite(velocity), has_position = Estimator::takes_positions && known(position);
        if (!finite(t) || !(has_velocity || has_position)) return drop(E_NONFINITE, stamp(t));
        if (!started() || t < time || !(t > gnss_time)) return drop(W_TIME_BACK, t);
        pending_time = gnss_time = t;
        pending = {S(0), false, velocity, velocity_std, position, position_std, has_velocity, has_position};
        if (t == time) close();
        return true;
    }

    bool gnss(double t, const Vec3<S>& velocity, const Vec3<S>& velocity_std) {
        const S unknown = S(NAN);
        return gnss(t, velocity, velocity_std, {NAN, NAN, NAN}, {unknown, unknown, unknown});
    }

    bool gnss(double t, const Vec3<S>& velocity, S velocity_std) { return gnss(t, velocity, {velocity_std, velocity_std, velocity_std}); }

    // The speed that the wheels tell at the last IMU sample, m/s; false when it is not finite.
    bool wheel(S speed) {
        if (!(speed * S(0) == S(0))) return drop(E_NONFINITE, stamp(time));
        if constexpr (Estimator::takes_wheels) estimator.wheel(params, speed);
        return true;
    }

    uint32_t status() const {
        const PlatformState<S>& p = estimator.platform;
        const bool aligned = p.aligned > S(0.5);
        const double since = time - epoch_time;
        const bool coasting = aligned && last_length > 0 && (since > coast_after * last_length || since > longest());
        return settled | (aligned ? 0u : INITIALIZING) | (aligned && !(p.heading_known > S(0.5)) ? ALIGNING : 0u) |
               (coasting ? COASTING : 0u) | (p.reverse > S(0.5) ? REVERSE : 0u) | estimator.manner();
    }

    Vec3<S> velocity_ned() const {
        return estimator.velocity(params, S(time - epoch_time));
    }

  private:
    double longest() const { return estimator.longest(params); }
    static bool finite(double x) { return x * 0.0 == 0.0; }
    static bool finite(const Vec3<S>& v) { return (v.x * S(0) + v.y * S(0)) + v.z * S(0) == S(0); }

    // A time to note where the sample has none.
    double stamp(double t) const { return finite(t) ? t : started() ? time : 0.0; }

    bool drop(EventCode code, double t) {
        note(events[code], t);
        return false;
    }

    bool take(double t, const Vec3<S>& w, const Vec3<S>& f) {
        time = advanced_to = t;
        gyro = w;
        accel = f;
        return true;
    }

    // What the estimator finds by itself becomes an event; it can only when its covariance has moved.
    void watch([[maybe_unused]] double t) {
        if constexpr (Estimator::takes_wheels) {
            if (estimator.rest.still > resting) note(events[S_STATIONARY], t);
            if (estimator.jumps > jumps) note(events[W_POSITION_JUMP], t);
            resting = estimator.rest.still;
            jumps = estimator.jumps;
        }
    }

    void advance_to(double t, const Vec3<S>& w, const Vec3<S>& f) {
        if (t > advanced_to) estimator.step(params, S(t - advanced_to), w, f);
        advanced_to = t;
        if (estimator.tick(params)) watch(t);
    }

    void close() {
        const double t = pending_time;
        const bool first = !(epoch_time > no_time);
        const double length = first ? 0.0 : t - epoch_time;
        if (length > max_interval || length > longest()) note(events[S_COAST], t);
        const bool usable = !first && !broken && length <= longest();
        pending.length = S(length);
        pending.usable = usable;
        const Interval<S> i = estimator.epoch(params, pending);
        interval = i;
        ++closed;
        if (!any(i.waiting > S(0.5))) {
            epoch_time = t;
            last_length = length;
            settled = estimator.settled();
        }
        if (estimator.platform.reverse > S(0.5)) note(events[S_REVERSE], t);
        watch(t);
        pending_time = no_time;
        broken = 0;
    }
};

}  // namespace levelhead

#endif
