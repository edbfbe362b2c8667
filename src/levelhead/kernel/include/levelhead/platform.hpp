// The virtual platform: an attitude that the control rate keeps level (Tereshkov 2013 and 2015, Eqs. 1-3), with GNSS
// velocity increments in place of a differentiated velocity, start-up levelling, and the heading steered by the course.
#ifndef LEVELHEAD_PLATFORM_HPP
#define LEVELHEAD_PLATFORM_HPP

#include "dcm.hpp"
#include "earth.hpp"
#include "geodesy.hpp"

namespace levelhead {

// What the user sets. Every constant has a meaning and a unit; there are no gains.
template <class S>
struct PlatformParams {
    S tau;               // attitude correction time constant, s
    S tau_heading;       // time constant of the heading steered by the course, s
    S min_course_speed;  // below this horizontal speed the course says nothing, m/s
    S gravity;           // m/s^2
    Vec3<S> lever_arm;   // from the IMU to the antenna, body axes, m
    uint32_t feel_earth; // 1: the papers' estimators compensate the Earth's rotation (tactical grade); 0: they neglect it
    S latitude;          // for that, rad
};

constexpr double max_interval = 10.0;       // a longer time between two epochs (or than 2 tau) is an outage, s
constexpr double align_time = 1.0;          // start-up levelling averages the specific force at least this long, s
constexpr double max_course_std = 0.26;     // 15 deg: a course less certain than this does not steer, rad
constexpr double standstill_speed = 0.15;   // slower than this, heading does not matter for levelling, m/s
constexpr double reverse_enter = 1.75;      // 100 deg between course and heading: driving backwards, rad
constexpr double reverse_leave = 1.40;      // 80 deg: forwards again; the difference is the hysteresis, rad
constexpr uint32_t orthonormalize_every = 32;  // samples
// A velocity increment over a large turn says little about the attitude within it, and the loop's phase lags by that turn:
// the level biases learn in full up to the first angle per GNSS interval and not at all from the second, rad.
constexpr double full_turn = 0.5;
constexpr double no_turn = 1.0;

template <class S>
struct PlatformState {
    Dcm<S> dcm_body_to_ned;    // C
    Vec3<S> control_rate_ned;  // w_p, held over the interval after the epoch that measured it, rad/s
    S hold;                    // how long w_p has still to act, s
    Vec3<S> frame_rate_ned;    // how the navigation frame turns in inertial space, as far as that is compensated, rad/s
    Vec3<S> angular_rate;      // the last bias-free angular rate, for the lever arm, rad/s

    // Since the last epoch:
    Dcm<S> dcm_at_epoch;       // C at its end
    Vec3<S> velocity_ned;      // GNSS velocity (of the IMU's place) at its end, m/s
    Vec3<S> delta_velocity;    // integral of C f dt, m/s
    S turn;                    // integral of the vertical angular rate, rad

    // Flags are kept as 0 or 1 so that every lane of a pack has its own.
    S have_velocity, aligned, heading_known, reverse;
    uint32_t samples;
};

// One closed GNSS interval, as the bias estimators see it.
template <class S>
struct Interval {
    S length;                   // T, s
    Vec3<S> control_rate_body;  // the papers' u = w_p^b: w_p seen from the mean attitude of the interval, rad/s
    Vec3<S> control_rate_body_level;  // the same without the heading's share
    Vec3<S> down_body;          // the vertical seen from the mean attitude
    S yaw_rate;                 // mean vertical angular rate, rad/s
    S learn;                    // 0 to 1: how much the level biases may learn from the interval
    S steered;                  // 1 where the course steered the heading, else 0
    S waiting;                  // 1 where start-up needs a longer interval: it goes on from its first epoch
    // What the uncertainty of the estimates needs besides:
    S turn;                     // integral of the vertical angular rate, rad
    S speed, velocity_std;      // horizontal, of the fix at its end, m/s; NaN where the fix has no sigma
    Vec3<S> amiss;              // GNSS less platform acceleration, NED; down: minus the vertical accelerometer bias, m/s^2
    S level;                    // 1 where the loop was closed and w_p set, else 0
    S aligned, heading_known;   // 1 from the epoch on that made it so, else 0
};

// Forget the attitude, not the biases: the next epochs level the platform anew.
template <class S>
void restart(PlatformState<S>& p, const Vec3<S>& specific_force) {
    p.dcm_body_to_ned = levelled(specific_force);
    p.control_rate_ned = p.frame_rate_ned = {S(0), S(0), S(0)};
    p.hold = S(0);
    p.have_velocity = p.aligned = p.heading_known = p.reverse = S(0);
    p.samples = 0;
    p.dcm_at_epoch = p.dcm_body_to_ned;
    p.delta_velocity = {S(0), S(0), S(0)};
    p.turn = S(0);
}

// Eq. (1): C' = C [w x] - [w_p x] C = C [(w - C^T w_p) x], one exact rotation per sample. `vertical` is the axis whose
// rate counts as yaw rate.
template <class S>
LEVELHEAD_HOT void advance(PlatformState<S>& p, S dt, const Vec3<S>& w, const Vec3<S>& f, const Vec3<S>& vertical) {
    const Dcm<S> c = p.dcm_body_to_ned;
    const S dt_control = minimum(dt, p.hold);
    p.hold = p.hold - dt_control;
    // w_p is steady in the platform's axes, so the body sees it at half of its own turn: u - theta x u / 2.
    const Vec3<S> theta = w * dt;
    const Vec3<S> control = transposed_times(c, p.control_rate_ned * dt_control + p.frame_rate_ned * dt);
    const Vec3<S> phi = theta - control + cross(theta, control) * S(0.5);
    // Eq. (2) integrated: C f with the half rotation that the body makes meanwhile.
    const Vec3<S> dv = f * dt;
    p.delta_velocity = p.delta_velocity + c * (dv + cross(phi, dv) * S(0.5));
    p.turn = p.turn + dot(vertical, theta);
    p.angular_rate = w;
    p.dcm_body_to_ned = rotated_in_body(c, phi);
    if (++p.samples % orthonormalize_every == 0) p.dcm_body_to_ned = orthonormalized(p.dcm_body_to_ned);
}

// Level from the specific force over the interval, corrected by the GNSS acceleration; heading from the course. In a hard
// turn the two disturb each other (levelling about a slanted axis also turns the heading), so they take turns; each round
// leaves at most half of what was wrong at 1 g of acceleration, a hundredth at 0.1 g. `rate` is one over the length.
template <class S, class Mask>
void align(PlatformState<S>& p, Mask with_course, S course, const Vec3<S>& gnss_force, S rate) {
    constexpr int rounds = 6;
    Dcm<S> c = p.dcm_body_to_ned;
    // The mean specific force, kept in the body's axes at the epoch so that it follows each correction.
    const Vec3<S> measured = transposed_times(c, p.delta_velocity * rate);
    for (int i = 0; i < rounds; ++i) {
        c = turned_about_vertical(c, select(with_course, wrap_angle(course - heading(c)), S(0)));
        c = carried(c, c * measured, gnss_force);
    }
    p.dcm_body_to_ned = orthonormalized(c);
}

// The angle from the heading to the course, with reverse driving recognised: its hysteresis lives in p.reverse.
template <class S, class Mask>
S course_innovation(PlatformState<S>& p, Mask moving, S course) {
    const S raw = wrap_angle(course - heading(p.dcm_body_to_ned));
    const S limit = select(p.reverse > S(0.5), S(reverse_leave), S(reverse_enter));
    p.reverse = select(moving, select(absolute(raw) > limit, S(1), S(0)), p.reverse);
    return select(p.reverse > S(0.5), wrap_angle(raw - S(pi)), raw);
}

// A GNSS epoch as the estimators see it: `length` is the time since the epoch before, `usable` is false where the interval
// between them must not be used (first epoch, gap, outage). Velocity, position or both; a NaN in a sigma is an unknown one.
template <class S>
struct Fix {
    S length;
    bool usable;
    Vec3<S> velocity, std;  // of the antenna, NED, m/s
    Geodetic position;      // of the antenna
    Vec3<S> position_std;   // NED, m
    bool has_velocity, has_position;
};

// The mean horizontal sigma of a fix, m/s.
template <class S>
S horizontal_std(const Vec3<S>& std) { return square_root(S(0.5) * (std.x * std.x + std.y * std.y)); }

// What a fix says, seen from the platform that it meets; masks were true before the fix did anything.
template <class S>
struct Sighting {
    Vec3<S> velocity;    // of the IMU's place, m/s
    S speed2, course;    // m^2/s^2, rad
    S rate;              // one over the length, 1/s
    Vec3<S> gnss_force;  // GNSS acceleration less gravity over the interval, m/s^2
    decltype(S(0) < S(0)) closed, was_aligned, knew_heading, trusted, at_rest, aligned_now, turned_now, waiting;
};

// Look at a fix; at start-up wait until the interval is long enough and level the platform, later set the heading with the
// first course.
template <class S>
Sighting<S> sight(PlatformState<S>& p, const PlatformParams<S>& k, const Fix<S>& fix) {
    Sighting<S> e;
    const Vec3<S> v = fix.velocity - p.dcm_body_to_ned * cross(p.angular_rate, k.lever_arm);
    const S speed2_before = p.velocity_ned.x * p.velocity_ned.x + p.velocity_ned.y * p.velocity_ned.y;
    const S std = horizontal_std(fix.std);
    e.velocity = v;
    e.speed2 = v.x * v.x + v.y * v.y;
    e.course = arc_tangent(v.y, v.x);
    // An unknown std (NaN) compares false and lets the speed decide alone.
    e.trusted = (e.speed2 > k.min_course_speed * k.min_course_speed) &
                !(std * std > S(max_course_std * max_course_std) * e.speed2);
    e.rate = S(1) / maximum(fix.length, S(1e-6));
    const Vec3<S> gravity = {S(0), S(0), k.gravity};
    e.gnss_force = (v - p.velocity_ned) * e.rate - gravity;
    e.closed = (p.have_velocity > S(0.5)) & fix.usable;
    e.was_aligned = p.aligned > S(0.5);
    e.knew_heading = p.heading_known > S(0.5);
    const S rest2 = S(standstill_speed * standstill_speed);
    e.at_rest = (e.speed2 < rest2) & (speed2_before < rest2);

    const auto long_enough = fix.length >= S(align_time) * S(0.999);
    e.aligned_now = e.closed & !e.was_aligned & long_enough;
    e.turned_now = e.was_aligned & !e.knew_heading & e.trusted;
    e.waiting = e.closed & !e.was_aligned & !long_enough;
    if (any(e.aligned_now)) {
        PlatformState<S> q = p;
        align(q, e.trusted, e.course, e.gnss_force, e.rate);
        p.dcm_body_to_ned = select(e.aligned_now, q.dcm_body_to_ned, p.dcm_body_to_ned);
        p.aligned = select(e.aligned_now, S(1), p.aligned);
        p.heading_known = select(e.aligned_now & e.trusted, S(1), p.heading_known);
    }
    if (any(e.turned_now)) {
        const S angle = select(e.turned_now, wrap_angle(e.course - heading(p.dcm_body_to_ned)), S(0));
        p.dcm_body_to_ned = turned_about_vertical(p.dcm_body_to_ned, angle);
        p.heading_known = select(e.turned_now, S(1), p.heading_known);
    }
    return e;
}

// Begin the next interval at this velocity; while start-up is still waiting, the present one goes on from its first epoch.
template <class S>
void begin_interval(PlatformState<S>& p, const Sighting<S>& e, const Vec3<S>& velocity) {
    const Vec3<S> zero = {S(0), S(0), S(0)};
    p.velocity_ned = select(e.waiting, p.velocity_ned, velocity);
    p.dcm_at_epoch = select(e.waiting, p.dcm_at_epoch, p.dcm_body_to_ned);
    p.delta_velocity = select(e.waiting, p.delta_velocity, zero);
    p.turn = select(e.waiting, p.turn, S(0));
    p.have_velocity = S(1);
}

// Tereshkov (2013), section 4: the frame turns with the Earth and the way made on it, and a moving body feels Coriolis. Before
// the heading is known nobody knows where North is, and only the vertical part can be taken off.
template <class S>
void feel_the_earth(PlatformState<S>& p, const PlatformParams<S>& k, Sighting<S>& e) {
    const FrameRate<S> rate = frame_rate(k.latitude, e.velocity);
    const auto known = p.heading_known > S(0.5);
    p.frame_rate_ned = select(known, rate.turn, Vec3<S>{S(0), S(0), rate.turn.z});
    e.gnss_force = e.gnss_force + cross(rate.coriolis, e.velocity) * select(known, S(1), S(0));
}

// Close the interval that ends with this fix (Eq. 3 on increments) and set w_p for the next one.
template <class S>
Interval<S> close_interval(PlatformState<S>& p, const PlatformParams<S>& k, const Fix<S>& fix) {
    const S length = fix.length;
    Sighting<S> e = sight(p, k, fix);
    Interval<S> out{};
    if (k.feel_earth) feel_the_earth(p, k, e);

    // Running: w_p = -k x (f_gnss - f_p), k = (0, 0, -1/(g tau)); a correction never exceeds what was measured (T <= tau).
    const Vec3<S> d = e.gnss_force - p.delta_velocity * e.rate;
    const S gain = minimum(S(1) / k.tau, e.rate) / k.gravity;
    const auto level = e.closed & e.was_aligned & (e.knew_heading | e.at_rest);
    const auto steer = e.closed & e.was_aligned & e.knew_heading & e.trusted;
    const S level_gain = select(level, gain, S(0));
    const S innovation = course_innovation(p, steer, e.course);
    const S steer_gain = select(steer, minimum(S(1) / k.tau_heading, e.rate), S(0));
    const Vec3<S> w_level = {-d.y * level_gain, d.x * level_gain, S(0)};
    const Vec3<S> w_p = {w_level.x, w_level.y, -innovation * steer_gain};
    p.control_rate_ned = w_p;
    p.hold = length;

    // The attitude that belongs to w_p is that of the interval in which it was measured, not the one in which it acts:
    // seen from the latter it lags by w_z T, and fast turns drive the accelerometer bias away instead of home.
    const Dcm<S> mean = {(p.dcm_at_epoch.x + p.dcm_body_to_ned.x) * S(0.5), (p.dcm_at_epoch.y + p.dcm_body_to_ned.y) * S(0.5),
                         (p.dcm_at_epoch.z + p.dcm_body_to_ned.z) * S(0.5)};
    out.length = length;
    out.control_rate_body_level = transposed_times(mean, w_level);
    out.control_rate_body = transposed_times(mean, w_p);
    out.down_body = mean.z;
    out.yaw_rate = p.turn * e.rate;
    const S trust = (S(no_turn) - absolute(p.turn)) * S(1.0 / (no_turn - full_turn));
    out.learn = select(level, clamp(trust, S(0), S(1)), S(0));
    out.steered = select(steer, S(1), S(0));
    out.waiting = select(e.waiting, S(1), S(0));
    out.turn = p.turn;
    out.speed = square_root(e.speed2);
    out.velocity_std = horizontal_std(fix.std);
    out.amiss = d;
    out.level = select(level, S(1), S(0));
    out.aligned = p.aligned;
    out.heading_known = p.heading_known;
    begin_interval(p, e, e.velocity);
    return out;
}

// Velocity now: the last epoch's plus what the accelerometers have added since, m/s.
template <class S>
Vec3<S> current_velocity(const PlatformState<S>& p, S gravity, S since_epoch) {
    return p.velocity_ned + p.delta_velocity + Vec3<S>{S(0), S(0), gravity * since_epoch};
}

// A bridged IMU gap hides motion: half of what the readings changed across it, and this much more.
constexpr double gap_rate = 0.01;   // rad/s
constexpr double gap_accel = 0.2;   // m/s^2

template <class S>
struct HiddenMotion {
    S tilt, velocity;  // variances per axis that a filter has to add, rad^2 and m^2/s^2
};

template <class S>
HiddenMotion<S> hidden_motion(S gap, const Vec3<S>& gyro_change, const Vec3<S>& accel_change) {
    const S angle = (norm(gyro_change) * S(0.5) + S(gap_rate)) * gap;
    const S speed = (norm(accel_change) * S(0.5) + S(gap_accel)) * gap;
    return {angle * angle, speed * speed};
}

// One sigma of what an estimator shows; NaN where it does not know it.
template <class S>
struct Sigma {
    Vec3<S> gyro_bias, accel_bias, attitude;  // body axes; body axes; roll, pitch, heading
    Vec3<S> velocity, position;               // North, East, Down, m/s and m
};

}  // namespace levelhead

#endif
