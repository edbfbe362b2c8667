// The phasor filter: a Kalman filter whose horizontal half is four complex numbers, five with positions. Between epochs only
// the attitude, the velocity and the way made are integrated; the covariance moves once per GNSS interval. Heading (with the
// vertical gyro bias) is a real pair of its own, the vertical are three real numbers. docs/theory/phasor.md
//
// As long as nothing has a direction (velocities, rest) one Hermitian covariance is all. Positions, wheels and an axle that
// does not slide have one; from the first of them on the directed moments are carried besides ("directed").
#ifndef LEVELHEAD_PHASOR_HPP
#define LEVELHEAD_PHASOR_HPP

#include "earth.hpp"
#include "joint.hpp"
#include "platform.hpp"
#include "settled.hpp"
#include "phasor_navigate.hpp"
#include "phasor_params.hpp"
#include "phasor_start.hpp"
#include "standstill.hpp"

namespace levelhead {

// Listens to the filter; this one does nothing and costs nothing.
struct NoRecorder {
    static constexpr bool listening = false;
    template <class Filter, class S>
    void moved(const Filter&, const Transition<S>&, const HeadingShare<S>&, S, S, const LiftStep<S>&) {}
    template <class S>
    void observed(const Observation<S>&) {}
    template <class S>
    void lifted(const LiftObservation<S>&) {}
    template <class Filter>
    void done(const Filter&) {}
};

template <class S, class Recorder = NoRecorder>
struct Phasor {
    using Scalar = S;
    using Params = PhasorParams<S>;
    static constexpr bool vertical_accel_bias = true, takes_positions = true, takes_wheels = true;

    PlatformState<S> platform;  // its velocity_ned and delta_velocity are the filter's own
    Vec3<S> gyro_bias, accel_bias;
    PhasorCovariance<S> horizontal;
    PhasorDirection<S> direction;
    PairCovariance<S> turning;           // heading & vertical gyro bias
    LiftCovariance<S> lifting;           // vertical velocity & accelerometer bias & position
    HeadingShare<S> share;               // of the heading pair's errors in the others, on top of their covariance
    Complex<S> azimuth;                  // e^{i alpha}: the level frame's x axis in North + i East
    Geodetic place;                      // of the IMU when the covariance last moved
    Vec3<S> shift;                       // since then: integral of delta_velocity, m
    S tracked, directed;                 // flags: the position is estimated; the directed moments are carried
    S elapsed;                           // since the covariance moved, s
    S gap_tilt, gap_velocity;            // variances to add for bridged IMU gaps
    S yaw_rate;                          // over the last interval, rad/s
    S turned;                            // integral of the squared yaw rate, rad^2/s
    S surprise, surprises;               // mean of the squared normalised innovations, and how many went into it
    S gravity_var, gravity;              // gravity: the parameter's, or the place's
    S unseen_rate2;                      // variance of the Earth's rate that hides in the level gyro biases: no North yet
    S latitude_felt;                     // the parameter's, or the place's; NaN: the Earth's rotation is not compensated
    Anchor<S> anchor;                    // a position that start-up takes its velocities from
    Standstill<S> rest;
    S jumps;                             // how often the position began anew because the fixes had left it
    S since_steered, since_constrained;  // since course or axle last corrected the heading, and the axle, s
    S implausible;                       // for how long positions have been far away, s
    S wheel_speed, wheel_scale, wheel_scale_var;  // the last reading (NaN: used up); speed over reading, and its variance
    Vec3<S> travel;                      // which way the axle that does not steer moves, body axes: learnt
    S travel_var;                        // rad^2
    S started;                           // flag: the heading that the user knew has been used
    Recorder recorder;

    void begin(const Params& k) {
        const S g = k.initial_gyro_bias_std * k.initial_gyro_bias_std, a = k.initial_accel_bias_std * k.initial_accel_bias_std;
        horizontal.gg = turning.bb = g;
        horizontal.aa = lifting.bb = a;
        turning.xx = S(unknown_heading_var);
        azimuth = {S(1), S(0)};
        surprise = wheel_scale = S(1);
        wheel_scale_var = S(wheel_scale_std * wheel_scale_std);
        gravity_var = k.gravity_std * k.gravity_std;
        gravity = k.platform.gravity;
        latitude_felt = latitude(k);
        place = anchor.place = {NAN, NAN, NAN};
        wheel_speed = S(NAN);
        since_steered = since_constrained = S(1e9);
        travel = {S(1), S(0), S(0)};
        travel_var = S(unknown_travel_std * unknown_travel_std);
        directed = k.constrained ? S(1) : S(0);
    }

    // The biases have wandered on while nobody looked.
    void restart(const Params& k, const Vec3<S>& specific_force, S lost) {
        levelhead::restart(platform, specific_force);
        horizontal.gg = horizontal.gg + k.noise.gyro_walk * lost;
        turning.bb = turning.bb + k.noise.gyro_walk * lost;
        horizontal.aa = horizontal.aa + k.noise.accel_walk * lost;
        lifting.bb = lifting.bb + k.noise.accel_walk * lost;
        // What heading and vertical gyro bias had put into the biases stays there, when these are forgotten.
        horizontal.gg = horizontal.gg + shared_variance(turning, share.x.g, share.b.g);
        horizontal.aa = horizontal.aa + shared_variance(turning, share.x.a, share.b.a);
        share = HeadingShare<S>{};
        anchor = {{NAN, NAN, NAN}, S(0), S(0)};
        rest.clear();
        rest.still = tracked = S(0);
        since_steered = S(1e9);
    }

    void bridged(S gap, const Vec3<S>& gyro_change, const Vec3<S>& accel_change) {
        const HiddenMotion<S> hidden = hidden_motion(gap, gyro_change, accel_change);
        gap_tilt = gap_tilt + hidden.tilt;
        gap_velocity = gap_velocity + hidden.velocity;
        rest.clear();
    }

    LEVELHEAD_HOT void step(const Params& k, S dt, const Vec3<S>& gyro, const Vec3<S>& accel) {
        const Vec3<S> before = platform.delta_velocity, w = gyro - gyro_bias, f = accel - accel_bias;
        advance(platform, dt, w, f, platform.dcm_body_to_ned.z);
        if (tracked > S(0.5)) shift = shift + (before + platform.delta_velocity) * (S(0.5) * dt);
        if (k.find_rest && !(rest.paused > S(0.5))) rest.add(gyro, f, dt);
        if (!(platform.aligned > S(0.5))) anchor.age = anchor.age + dt;
        elapsed = elapsed + dt;
    }

    // Within a long interval, or a sharp turn, the covariance moves without waiting for the epoch: true where it has.
    LEVELHEAD_HOT bool tick(const Params& k) {
        if (!((elapsed >= S(longest_step) || absolute(platform.turn) > S(largest_turn)) && platform.aligned > S(0.5))) return false;
        move(k);
        aid(k, k.constrained, false);
        recorder.done(*this);
        return true;
    }

    double longest(const Params&) const { return max_interval; }

    Vec3<S> velocity(const Params&, S) const { return current_velocity(platform, gravity, elapsed); }

    // Where the IMU is now.
    Geodetic position() const {
        if (!(tracked > S(0.5))) return {NAN, NAN, NAN};
        return levelhead::moved(place, widened(way(elapsed)));
    }

    Interval<S> epoch(const Params& k, const Fix<S>& given) {
        Interval<S> out{};
        out.length = given.length;
        Fix<S> fix = given;
        if (fix.has_position) know_gravity(k, fix.position);
        if (platform.aligned > S(0.5)) move(k);
        const bool heading = platform.heading_known > S(0.5);
        if (!fix.has_velocity && !heading && !from_positions(*this, k, fix)) {
            if (platform.aligned > S(0.5)) {
                aid(k, false, false);
                recorder.done(*this);
            } else if (anchor.age > S(0)) {
                out.waiting = S(1);
            } else {  // the first position of all: the interval begins here, without a velocity
                platform.delta_velocity = {S(0), S(0), S(0)};
                platform.turn = platform.have_velocity = S(0);
            }
            return out;
        }
        if (fix.has_velocity) {
            meet(k, fix, out);
        } else {
            navigate(k, fix);
        }
        return out;
    }

    uint32_t settled() const {
        return settled_bits(square_root(horizontal.gg + unseen_rate2), square_root(horizontal.aa), square_root(turning.bb),
                            square_root(turning.xx), turned > S(enough_turning));
    }

    uint32_t manner() const {
        return (rest.still > S(0.5) ? STATIONARY : 0u) | (since_steered < S(steer_memory) && platform.heading_known > S(0.5) ? COURSE : 0u);
    }

    void wheel(const Params&, S speed) { wheel_speed = speed; }

    Sigma<S> sigma() const { return shown_sigma(*this); }

    // ---- the steps; start-up and what navigates (phasor_start.hpp, phasor_navigate.hpp) are made of them ----

    Complex<S> to_level(S north, S east) const { return conj(azimuth) * Complex<S>{north, east}; }

    // Take what a measurement found off the state.
    void apply(const Correction<S>& c) {
        PlatformState<S>& p = platform;
        const PhasorVector<S>& x = c.x;
        const Complex<S> nu = azimuth * x.n, theta = azimuth * x.t;
        p.velocity_ned = p.velocity_ned - Vec3<S>{nu.re, nu.im, c.lift.v};
        add_bias(gyro_bias, x.g, c.bias);
        add_bias(accel_bias, x.a, c.lift.b);
        if (tracked > S(0.5)) {
            const Complex<S> way = azimuth * x.p;
            place = levelhead::moved(place, {double(-way.re), double(-way.im), double(-c.lift.d)});
        }
        p.dcm_body_to_ned = rotated_in_ned(p.dcm_body_to_ned, {-theta.re, -theta.im, -c.turn});
        turn_azimuth(-c.turn);
    }

    Observation<S> measured(const Row<S>& row, S error, S variance) {
        const Observation<S> o = levelhead::observe(horizontal, direction, turning, share, row, error, variance);
        recorder.observed(o);
        return o;
    }

    void take(const Row<S>& row, S error, S variance) { apply(measured(row, error, variance).correction()); }

    // Two components of one horizontal measurement; the second has been told something by the first.
    Correction<S> measured(const Row<S>& first, const Row<S>& second, S error, S other_error, S variance, S other_variance) {
        const Observation<S> a = measured(first, error, variance);
        const S told = (inner(second.x, a.gain).re + second.turn * a.turn.x + second.bias * a.turn.b) * error;
        return a.correction() + measured(second, other_error - told, other_variance).correction();
    }

    // ... and what was measured of the vertical beside them.
    void take(const Row<S>& first, const Row<S>& second, S error, S other_error, S variance, S other_variance, const LiftObservation<S>& o) {
        apply(measured(first, second, error, other_error, variance, other_variance) + lifted(o));
        forget_rounding();
    }

    void take(const Row<S>& first, const Row<S>& second, S error, S other_error, S variance, S other_variance) {
        apply(measured(first, second, error, other_error, variance, other_variance));
        forget_rounding();
    }

    void forget_rounding() {
        // Nothing but rounding is left of a direction where both components had the same variance.
        if (!(directed > S(0.5))) direction = PhasorDirection<S>{};
    }

    S spread(const Row<S>& row, S variance) const { return expected(horizontal, direction, turning, share, row, variance); }

    Correction<S> lifted(const LiftObservation<S>& o) {
        recorder.lifted(o);
        return o.correction();
    }

    // From here on what has a direction is told apart.
    void direct() { directed = S(1); }

    S latitude(const Params& k) const {
        if (!k.feel_earth) return S(NAN);
        return k.latitude == k.latitude ? k.latitude : S(place.latitude);
    }

    void know_gravity(const Params& k, const Geodetic& at) {
        if (k.feel_earth && k.platform.gravity == S(standard_gravity)) gravity = S(normal_gravity(at.latitude, at.height));
    }

    // The way made since the covariance moved, t ago, m.
    Vec3<S> way(S t) const { return platform.velocity_ned * t + shift + Vec3<S>{S(0), S(0), S(0.5) * gravity * t * t}; }

    // Bring velocity, position and covariance up to now.
    void move(const Params& k) {
        PlatformState<S>& p = platform;
        const S t = elapsed, phi = p.turn;
        // What carries the tilt into the velocity is the mean vertical force; a bump moves it, bad data must not.
        const S force = t > S(0) ? clamp(-p.delta_velocity.z / t, S(0.5) * gravity, S(2) * gravity) : gravity;
        const Vec3<S> dv = p.delta_velocity, made = way(t), gained = p.velocity_ned + dv + Vec3<S>{S(0), S(0), gravity * t};
        p.velocity_ned = gained;
        feel_the_earth(k, t);
        turn_azimuth(phi);
        const bool positions = tracked > S(0.5), both = directed > S(0.5);
        Transition<S> f = transition(t, phi, force);
        if (positions) {
            place = levelhead::moved(place, widened(made + (p.velocity_ned - gained) * (S(0.5) * t)));
            know_gravity(k, place);
            add_position(f, t, phi, force);
            propagate_position(horizontal, f);
            if (both) propagate_position(direction, f);
        }
        propagate(horizontal, f);
        if (both) propagate(direction, f);
        // A heading that is not known has no small error that could be estimated.
        Complex<S> push = {S(0), S(0)};
        if (p.heading_known > S(0.5)) push = times_i(to_level(dv.x, dv.y));
        const HeadingShare<S> pushes = pushed(push, t, positions);
        const auto add = [&](const PhasorVector<S>& v, S variance) {
            add_seen(horizontal, v, variance, positions);
            if (both) add_seen(direction, v, variance, positions);
        };
        propagate(turning, share, add, f, pushes, positions, t, k.noise.gyro * t + gap_tilt, k.noise.gyro_walk);
        if (positions) add_position_noise(horizontal, k.noise, t, force);
        add_noise(horizontal, k.noise, t, force);
        propagate(lifting, t, k.noise.accel, k.noise.accel_walk, positions);
        horizontal.tt = horizontal.tt + gap_tilt;
        horizontal.nn = horizontal.nn + gap_velocity;
        lifting.vv = lifting.vv + gap_velocity;
        if (positions) {  // what a gap hides of the velocity has moved the position, too
            horizontal.np.re = horizontal.np.re + S(0.5) * t * gap_velocity;
            horizontal.pp = horizontal.pp + S(1.0 / 3) * t * t * gap_velocity;
            lifting.dv = lifting.dv + S(0.5) * t * gap_velocity;
            lifting.dd = lifting.dd + S(1.0 / 3) * t * t * gap_velocity;
        }
        // A tick may have come at the very epoch: nothing has moved since, and the yaw rate is still what it was.
        if (t > S(0)) {
            yaw_rate = phi / t;
            turned = minimum(turned + phi * yaw_rate, S(1e3));
        }
        since_steered = minimum(since_steered + t, S(1e9));
        since_constrained = minimum(since_constrained + t, S(1e9));
        rest.wait(p.velocity_ned.x * p.velocity_ned.x + p.velocity_ned.y * p.velocity_ned.y, t);
        anchor.age = anchor.age + t;
        anchor.turn = anchor.turn + phi;
        recorder.moved(*this, f, pushes, t, S(1), LiftStep<S>{t, S(1), positions ? S(1) : S(0)});
        elapsed = gap_tilt = gap_velocity = p.turn = S(0);
        p.delta_velocity = shift = {S(0), S(0), S(0)};
    }

    void turn_azimuth(S angle) {
        const RotationCoefficients<S> r = rotation_coefficients(angle * angle);
        const Complex<S> u = azimuth * Complex<S>{S(1) - angle * angle * r.b, angle * r.a};
        azimuth = u * (S(1.5) - S(0.5) * norm2(u));  // one Newton step towards |u| = 1
    }

    // Coriolis acceleration over the time t, and the rate for the platform to turn at from here on. Before the heading is
    // known nobody knows where North is, and only the vertical part can be taken off.
    void feel_the_earth(const Params& k, S t) {
        latitude_felt = latitude(k);
        const FrameRate<S> rate = frame_rate(latitude_felt, platform.velocity_ned);
        const auto known = platform.heading_known > S(0.5);
        unseen_rate2 = select(known, S(0), S(0.5) * (rate.turn.x * rate.turn.x + rate.turn.y * rate.turn.y));
        platform.velocity_ned = platform.velocity_ned - cross(rate.coriolis, platform.velocity_ned) * select(known, t, S(0));
        platform.control_rate_ned = select(known, rate.turn, Vec3<S>{S(0), S(0), rate.turn.z});
        platform.hold = S(1e9);
    }

    // A level-frame bias (horizontal, down) as seen by the body's axes.
    void add_bias(Vec3<S>& bias, const Complex<S>& level, S down) const {
        const Complex<S> ned = azimuth * level;
        bias = bias + transposed_times(platform.dcm_body_to_ned, {ned.re, ned.im, down});
    }

    // ---- what an epoch with a velocity does ----

    void meet(const Params& k, const Fix<S>& fix, Interval<S>& out) {
        const Dcm<S> before = platform.dcm_body_to_ned;
        PlatformParams<S> here = k.platform;
        here.gravity = gravity;
        const Sighting<S> e = sight(platform, here, fix);
        out.waiting = select(e.waiting, S(1), S(0));
        if (k.find_rest) rest.see(e.velocity, square_root(velocity_variance(k, horizontal_std(fix.std))));
        if (e.was_aligned) {
            if (e.turned_now) {
                // The level frame's x axis stays where it was in the body while the platform is turned to the first course.
                const Vec3<S> axis = transposed_times(before, {azimuth.re, azimuth.im, S(0)});
                azimuth = {dot(platform.dcm_body_to_ned.x, axis), dot(platform.dcm_body_to_ned.y, axis)};
                take_course(*this, k, e, fix, wrap_angle(heading(platform.dcm_body_to_ned) - heading(before)));
            }
            // Without a heading the accelerations of a moving vehicle have no direction: take the velocity, learn nothing.
            if (e.knew_heading || e.at_rest) {
                correct(k, e, fix);
            } else {
                recorder.done(*this);
                take_velocity(*this, k, e.velocity, fix);
            }
            locate(*this, k, fix);
            aid(k, k.constrained, true);
        } else if (e.aligned_now) {
            align_covariance(*this, k, e, fix, known_heading(*this, k, e));
            locate(*this, k, fix);
        }
        begin_interval(platform, e, platform.aligned > S(0.5) ? platform.velocity_ned : e.velocity);
        if (e.was_aligned || e.aligned_now) recorder.done(*this);
    }

    // An epoch with a position only: the heading is known, the filter's own velocity does the rest.
    void navigate(const Params& k, const Fix<S>& fix) {
        locate(*this, k, fix);
        aid(k, true, true);
        platform.dcm_at_epoch = platform.dcm_body_to_ned;
        recorder.done(*this);
    }

    // What needs no fix: rest, the axle that does not slide, the wheels. `gnss` tells whether an epoch has just been taken.
    void aid(const Params& k, bool constrained, bool gnss) {
        if (k.find_rest && rest.time >= S(rest_window)) rest_now(*this, k);
        if (rest.still > S(0.5) || !(platform.heading_known > S(0.5))) return;
        if (constrained) constrain(*this, k, gnss);
        if (wheel_speed == wheel_speed) roll_on(*this, k, gnss);
        wheel_speed = S(NAN);
    }

    S velocity_variance(const Params& k, S std) const { return stated_variance(std, k.velocity_std, least_velocity_std, most_velocity_std); }
    S position_variance(const Params& k, S std) const { return stated_variance(std, k.position_std, least_position_std, most_position_std); }

    // One look at the course: velocity noise, and how much the vehicle slides or swings. That stays for a while, so that
    // many looks tell no more about it than one.
    S course_variance(const Params& k, const Sighting<S>& e, const Fix<S>& fix, S looks) const {
        const S sliding = k.sideslip_std * k.sideslip_std + k.axle_std * k.axle_std * yaw_rate * yaw_rate / e.speed2;
        return velocity_variance(k, horizontal_std(fix.std)) / e.speed2 + sliding * looks;
    }

    // Innovations beyond what chance allows are outliers: all of the fix is then trusted so much less that the worst of them
    // becomes just possible. A filter that is wrong itself is still pulled, by a few sigma per epoch.
    static S doubt(const Complex<S>& z, S s, S down, S s_down, S course, S s_course) {
        const S worst = maximum(S(1.0 / gate_pair) * norm2(z) / s,
                                S(1.0 / gate_one) * maximum(down * down / s_down, course * course / s_course));
        return maximum(worst, S(1));
    }

    void correct(const Params& k, const Sighting<S>& e, const Fix<S>& fix) {
        const Vec3<S> error = platform.velocity_ned - e.velocity;
        const Complex<S> z = to_level(error.x, error.y);
        // An axle that does not slide tells more than the course does: the same, at the filter's own velocity.
        const auto steer = e.knew_heading & e.trusted & !k.constrained;
        const S innovation = steer ? -course_innovation(platform, steer, e.course) : S(0);
        const S r = velocity_variance(k, horizontal_std(fix.std)), r_down = velocity_variance(k, fix.std.z);
        const S looks = maximum(S(1), S(2.0 * sideslip_time) * e.rate);
        const S r_course = steer ? course_variance(k, e, fix, looks) : S(1);
        const S plain = horizontal.nn + r + shared_variance(turning, share.x.n, share.b.n);
        const S f = doubt(z, plain, error.z, lifting.vv + r_down, innovation, turning.xx + r_course);
        surprises = minimum(surprises + S(1), S(1e5));
        surprise = surprise + (S(0.5) * norm2(z) / (plain * f) - surprise) / surprises;

        Correction<S> all;
        if (directed > S(0.5)) {
            const S more = (f - S(1)) * plain;
            Row<S> north{}, east{};
            north.x.n = {S(1), S(0)};
            east.x.n = {S(0), S(1)};
            all = measured(north, east, z.re, z.im, r + more, r + more);
        } else {
            all = velocity_at_once(z, f * (horizontal.nn + r));
        }
        if (steer) {
            const Observation<S> o = observe_heading(turning, share, innovation - all.turn, r_course * f + (f - S(1)) * turning.xx);
            recorder.observed(o);
            all = all + o.correction();
            since_steered = S(0);
        }
        apply(all + lifted(observe_velocity(lifting, error.z, r_down * f + (f - S(1)) * lifting.vv)));
    }

    // Both components in one complex number, while nothing has a direction; `s` is the innovation variance without the pair's
    // part.
    Correction<S> velocity_at_once(const Complex<S>& z, S s) {
        const PhasorVector<S> gain = measure_velocity(horizontal, s);
        const HeadingGain<S> aside = measure_velocity(turning, share, gain, s);
        if constexpr (Recorder::listening) record_complex(gain, aside, s, z);
        const S turn = inner(aside.x, z), bias = inner(aside.b, z);
        // The five give up what the pair had put into them.
        return {gain * z + share.x * turn + share.b * bias, turn, bias, {}};
    }

    // The same as the two real measurements that it is made of.
    void record_complex(const PhasorVector<S>& gain, const HeadingGain<S>& aside, S s, const Complex<S>& z) {
        const PairGain<S>&g1 = aside.first, g2 = aside.second;
        // After the real part alone the shares still held what the imaginary one took from them.
        const PhasorVector<S> x1 = share.x + gain * Complex<S>{S(0), aside.seen_x.im}, b1 = share.b + gain * Complex<S>{S(0), aside.seen_b.im};
        Observation<S> a{}, b{};
        a.row.x.n = {S(1), S(0)};
        a.gain = gain + x1 * g1.x + b1 * g1.b;
        a.turn = g1;
        a.error = z.re;
        a.left = (s - gain.n.re * s) / g1.variance;
        b.row.x.n = {S(0), S(1)};
        b.gain = gain * Complex<S>{S(0), S(1)} + share.x * g2.x + share.b * g2.b;
        b.turn = g2;
        b.error = z.im - a.gain.n.im * z.re;
        b.left = (s - gain.n.re * s) / g2.variance;
        recorder.observed(a);
        recorder.observed(b);
    }
};

}  // namespace levelhead

#endif
