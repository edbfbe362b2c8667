// From smoothed epochs to smoothed samples: the readings are integrated from each epoch to the next, and what then misses
// the next one is taken off evenly on the way, so that the result has no step anywhere.
#ifndef LEVELHEAD_RETRACE_HPP
#define LEVELHEAD_RETRACE_HPP

#include "smoother.hpp"
#include "stream.hpp"

namespace levelhead {

// The log's readings, rows of three, as `Stream` took them.
template <class S>
struct Readings {
    const double* time;
    const S *gyro, *accel;
    long count;
};

// What is shown at one sample.
template <class S>
struct Retraced {
    Dcm<S> dcm_body_to_ned;
    Vec3<S> velocity_ned, gyro_bias, accel_bias;
    Sigma<S> sigma;
    bool heading_known;
    Geodetic place;  // NaN where positions were not used
};

template <class S>
Vec3<S> between(const Vec3<S>& a, const Vec3<S>& b, S part) { return a + (b - a) * part; }

template <class S>
Sigma<S> between(const Sigma<S>& a, const Sigma<S>& b, S part) {
    return {between(a.gyro_bias, b.gyro_bias, part), between(a.accel_bias, b.accel_bias, part), between(a.attitude, b.attitude, part),
            between(a.velocity, b.velocity, part), between(a.position, b.position, part)};
}

// The rotation vector of a small rotation.
template <class S>
Vec3<S> small_angle(const Dcm<S>& c) {
    // sin(angle) times the axis; the angle follows from it and stays right up to a right angle.
    const Vec3<S> s = Vec3<S>{c.z.y - c.y.z, c.x.z - c.z.x, c.y.x - c.x.y} * S(0.5);
    const S sine2 = dot(s, s), length = square_root(sine2);
    const S angle = arc_tangent(length, S(0.5) * (c.x.x + c.y.y + c.z.z - S(1)));
    return s * (length > S(1e-6) ? angle / length : S(1));
}

// a b^T.
template <class S>
Dcm<S> times_transposed(const Dcm<S>& a, const Dcm<S>& b) {
    const auto row = [&](const Vec3<S>& r) { return Vec3<S>{dot(r, b.x), dot(r, b.y), dot(r, b.z)}; };
    return {row(a.x), row(a.y), row(a.z)};
}

// One way from a smoothed epoch along the readings, forwards or backwards.
template <class S>
struct Walk {
    PlatformState<S> platform;
    double time;
    Vec3<S> gyro_bias, accel_bias, start_velocity, shift;
    Geodetic start_place;
    S gravity;
    double start;

    Walk(const SmootherRecord<S>& r, const Vec3<S>& w, const Vec3<S>& f) {
        platform = PlatformState<S>{};
        platform.dcm_body_to_ned = r.dcm_body_to_ned;
        start_velocity = platform.velocity_ned = r.velocity_ned;
        start_place = r.place;
        if (!r.tracked) start_place.latitude = NAN;
        shift = {S(0), S(0), S(0)};
        const FrameRate<S> rate = frame_rate(r.latitude, r.velocity_ned);
        platform.control_rate_ned = rate.turn;
        platform.hold = S(1e9);
        start = time = r.time;
        gyro_bias = w;
        accel_bias = f;
        gravity = r.gravity;
        coriolis = cross(rate.coriolis, r.velocity_ned) * S(-1);
    }

    // To the time t, within the step between the samples `after - 1` and `after`.
    void to(double t, const Readings<S>& x, long after) {
        const long b = after < x.count ? after : x.count - 1, a = after > 0 ? after - 1 : 0;
        const auto mean = [&](const S* v) {
            return Vec3<S>{v[3 * a] + v[3 * b], v[3 * a + 1] + v[3 * b + 1], v[3 * a + 2] + v[3 * b + 2]} * S(0.5);
        };
        const Vec3<S> before = platform.delta_velocity;
        advance(platform, S(t - time), mean(x.gyro) - gyro_bias, mean(x.accel) - accel_bias, platform.dcm_body_to_ned.z);
        shift = shift + (before + platform.delta_velocity) * S(0.5 * (t - time));
        time = t;
    }

    Vec3<S> velocity() const {
        const S t = S(time - start);
        return start_velocity + platform.delta_velocity + Vec3<S>{S(0), S(0), gravity * t} + coriolis * t;
    }

    // The way made, less or more than it, `besides`.
    Geodetic position(const Vec3<S>& besides) const {
        const S t = S(time - start);
        if (!known(start_place)) return start_place;
        return moved(start_place, widened(start_velocity * t + shift + (Vec3<S>{S(0), S(0), gravity} + coriolis) * (S(0.5) * t * t) + besides));
    }

  private:
    Vec3<S> coriolis;
};

// Show every sample in [from, to): `show(index, Retraced)`. The records are smoothed ones, in time order.
template <class S>
struct Retracer {
    const SmootherRecord<S>* records;
    long count;
    Readings<S> readings;

    template <class Show>
    void run(Show show) const {
        if (count == 0) return;
        long next = 0;
        while (next < readings.count && readings.time[next] < records[0].time) ++next;
        backwards(records[0], 0, next, show);
        for (long k = 0; k + 1 < count; ++k) {
            long end = next;
            while (end < readings.count && readings.time[end] < records[k + 1].time) ++end;
            if (records[k + 1].fresh) {
                const long split = first_after_reset(next, end);
                forwards(records[k], next, split, show);
                backwards(records[k + 1], split, end, show);
            } else if (end > next) {
                joined(records[k], records[k + 1], next, end, show);
            }
            next = end;
        }
        forwards(records[count - 1], next, readings.count, show);
    }

  private:
    // The first sample after the last gap that made the filter level anew; the samples before it belong to the epoch before.
    long first_after_reset(long begin, long end) const {
        for (long i = end - 1; i > 0 && i >= begin; --i)
            if (readings.time[i] - readings.time[i - 1] > reset_gap) return i;
        return begin;
    }

    template <class Show>
    void forwards(const SmootherRecord<S>& r, long begin, long end, Show show) const {
        Walk<S> walk(r, r.gyro_bias, r.accel_bias);
        for (long i = begin; i < end; ++i) {
            if (i > 0 && readings.time[i] - readings.time[i - 1] > reset_gap) return;
            walk.to(readings.time[i], readings, i);
            show(i, Retraced<S>{walk.platform.dcm_body_to_ned, walk.velocity(), r.gyro_bias, r.accel_bias, r.sigma, r.heading_known, walk.position({S(0), S(0), S(0)})});
        }
    }

    template <class Show>
    void backwards(const SmootherRecord<S>& r, long begin, long end, Show show) const {
        Walk<S> walk(r, r.gyro_bias, r.accel_bias);
        for (long i = end - 1; i >= begin; --i) {
            if (i + 1 < readings.count && readings.time[i + 1] - readings.time[i] > reset_gap) return;
            walk.to(readings.time[i], readings, i + 1);
            show(i, Retraced<S>{walk.platform.dcm_body_to_ned, walk.velocity(), r.gyro_bias, r.accel_bias, r.sigma, r.heading_known, walk.position({S(0), S(0), S(0)})});
        }
    }

    // Twice over the samples between two epochs: to see what is missed, then to show.
    template <class Show>
    void joined(const SmootherRecord<S>& a, const SmootherRecord<S>& b, long begin, long end, Show show) const {
        const Vec3<S> gyro_bias = between(a.gyro_bias, b.gyro_bias, S(0.5)), accel_bias = between(a.accel_bias, b.accel_bias, S(0.5));
        Walk<S> ahead(a, gyro_bias, accel_bias);
        for (long i = begin; i < end; ++i) ahead.to(readings.time[i], readings, i);
        ahead.to(b.time, readings, end);
        const Vec3<S> missed_angle = small_angle(times_transposed(b.dcm_body_to_ned, ahead.platform.dcm_body_to_ned));
        const Vec3<S> missed_velocity = b.velocity_ned - ahead.velocity();
        Vec3<S> missed_way = {S(0), S(0), S(0)};
        if (a.tracked && b.tracked) missed_way = narrowed<S>(offset_ned(ahead.position(missed_way), b.place));
        const S per_second = S(1) / S(b.time - a.time);
        Walk<S> walk(a, gyro_bias, accel_bias);
        for (long i = begin; i < end; ++i) {
            walk.to(readings.time[i], readings, i);
            const S part = S(walk.time - a.time) * per_second;
            show(i, Retraced<S>{rotated_in_ned(walk.platform.dcm_body_to_ned, missed_angle * part),
                                walk.velocity() + missed_velocity * part, between(a.gyro_bias, b.gyro_bias, part),
                                between(a.accel_bias, b.accel_bias, part), between(a.sigma, b.sigma, part), a.heading_known,
                                walk.position(missed_way * part)});
        }
    }
};

}  // namespace levelhead

#endif
