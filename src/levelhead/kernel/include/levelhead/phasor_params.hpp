// What the user tells the phasor filter, its limits, and how its variances are shown.
#ifndef LEVELHEAD_PHASOR_PARAMS_HPP
#define LEVELHEAD_PHASOR_PARAMS_HPP

#include "joint.hpp"
#include "platform.hpp"

namespace levelhead {

template <class S>
struct PhasorParams {
    PlatformParams<S> platform;  // of which tau and tau_heading are not used
    PhasorNoise<S> noise;
    S velocity_std;                // where the fix tells none, m/s
    S sideslip_std;                // between course and heading, rad; it stays for sideslip_time
    S axle_std;                    // how far the IMU can be from where course and heading agree in a turn, m
    S initial_gyro_bias_std, initial_accel_bias_std;
    S latitude;                    // rad; NaN: from the positions; without them the Earth's rotation is not compensated
    S gravity_std;                 // shown in the sigma of the vertical accelerometer bias only, m/s^2
    S position_std;                // where the fix tells none, m
    S timing_std;                  // of the stamps of fixes against the IMU's: a position is off by so much way, s
    S wheel_std;                   // of one wheel speed, m/s
    Vec3<S> rear_axle;             // from the IMU to the axle that does not steer, body axes, m
    S heading, heading_std;        // known before the drive, rad; a sigma of 0: not known
    bool constrained;              // that axle does not slide, with or without GNSS
    bool feel_earth;               // the Earth turns, and gravity is the place's
    bool find_rest;                // look for standstill
};

// A little below one second, so that float and double agree on when a second of samples is over.
constexpr double longest_step = 0.999;         // the covariance moves at least this often, s ...
constexpr double largest_turn = 0.35;          // ... and at least once per such a turn: within it the rate counts as even, rad
// An unknown heading has no variance; this one is large enough that the first course says nothing about the gyro bias, however
// long the vehicle has stood before, rad^2.
constexpr double unknown_heading_var = 1e6;
constexpr double least_velocity_std = 1e-4, most_velocity_std = 1e3;  // what a fix may claim of itself, m/s
constexpr double least_position_std = 1e-3, most_position_std = 1e6;  // m

constexpr double gate_pair = 16.0;     // squared normalised horizontal innovation: one in 3000 is above it by chance
constexpr double gate_one = 14.0;      // the same for one real innovation: one in 5000
constexpr double sideslip_time = 2.0;  // how long a sideslip stays, s
constexpr double tilt_time = 30.0;     // how long an error of the tilt stays, s
constexpr double unknown_travel_std = 0.2;  // which way the axle moves in the body, before GNSS has told, rad
constexpr double steer_memory = 3.0;   // a course or axle this long ago still counts as the source of the heading, s
constexpr double wheel_scale_std = 0.05;    // a tyre's radius before anything has measured it, relative
constexpr double jump_time = 10.0;     // positions that are far away for this long are right, and the filter's is wrong, s
constexpr double jump_doubt = 4.0;     // ... where far means so many times the gate
constexpr double hidden_accel = 0.5;   // what start-up from positions alone reckons with between two of them, m/s^2

// Start-up takes velocities from the way since this position.
template <class S>
struct Anchor {
    Geodetic place;  // of the IMU
    S age, turn;     // s and rad since then
};

// What a fix may say of itself.
template <class S>
S stated_variance(S std, S otherwise, double least, double most) {
    const S known = std == std ? clamp(std, S(least), S(most)) : otherwise;
    return known * known;
}

// Variances in the level frame, horizontal (the same for all directions) and vertical, as sigmas of what is shown.
template <class S>
Sigma<S> level_sigma(const Vec3<S>& down_body, S gyro, S gyro_down, S accel, S accel_down, S tilt, S heading) {
    const Vec3<S>& d = down_body;
    const auto body = [&](S level, S down) {
        const auto axis = [&](S z) { return square_root(maximum(level + (down - level) * z * z, S(0))); };
        return Vec3<S>{axis(d.x), axis(d.y), axis(d.z)};
    };
    const S cos2 = maximum(S(1) - d.x * d.x, S(1e-6));  // of the pitch
    const S level = maximum(tilt, S(0));
    Sigma<S> out{};
    out.gyro_bias = body(gyro, gyro_down);
    out.accel_bias = body(accel, accel_down);
    out.attitude = {square_root(level / cos2), square_root(level), square_root(heading + level * d.x * d.x / cos2)};
    return out;
}

// North and East of one of the five: `own` and `directed` are its diagonal moments, `x` and `b` its shares of the pair.
template <class S>
void horizontal_sigma(Vec3<S>& out, S own, const Complex<S>& directed, const PairCovariance<S>& pair, const Complex<S>& x,
                      const Complex<S>& b, const Complex<S>& azimuth) {
    const Complex<S> c = azimuth * azimuth * directed, north = azimuth * x, turn = azimuth * b;
    const auto axis = [&](S u, S v, S moment) {
        return square_root(maximum(own + moment + pair.xx * u * u + S(2) * pair.xb * u * v + pair.bb * v * v, S(0)));
    };
    out.x = axis(north.re, turn.re, c.re);
    out.y = axis(north.im, turn.im, -c.re);
}

// All sigmas of a phasor filter.
template <class Filter>
auto shown_sigma(const Filter& f) {
    using S = typename Filter::Scalar;
    const PairCovariance<S>& pair = f.turning;
    const HeadingShare<S>& share = f.share;
    const bool aligned = f.platform.aligned > S(0.5), tracked = aligned && f.tracked > S(0.5);
    const S any_angle = S(pi * pi), heading = f.platform.heading_known > S(0.5) ? pair.xx : any_angle, unknown = S(NAN);
    Sigma<S> out = level_sigma(f.platform.dcm_body_to_ned.z, f.horizontal.gg + f.unseen_rate2 + shared_variance(pair, share.x.g, share.b.g), pair.bb,
                               f.horizontal.aa + shared_variance(pair, share.x.a, share.b.a), f.lifting.bb + f.gravity_var,
                               f.horizontal.tt + shared_variance(pair, share.x.t, share.b.t), heading);
    if (!aligned) out.attitude = {S(pi), S(pi), S(pi)};
    out.velocity = out.position = {unknown, unknown, unknown};
    if (aligned) {
        horizontal_sigma(out.velocity, f.horizontal.nn, f.direction.nn, pair, share.x.n, share.b.n, f.azimuth);
        out.velocity.z = square_root(maximum(f.lifting.vv, S(0)));
    }
    if (tracked) {
        horizontal_sigma(out.position, f.horizontal.pp, f.direction.pp, pair, share.x.p, share.b.p, f.azimuth);
        out.position.z = square_root(maximum(f.lifting.dd, S(0)));
    }
    return out;
}

}  // namespace levelhead

#endif
