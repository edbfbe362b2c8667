// The phasor filter: a Kalman filter whose horizontal half is four complex numbers. Between epochs only the attitude and
// the velocity are integrated; the covariance moves once per GNSS interval. Heading (with the vertical gyro bias) and
// vertical velocity (with the vertical accelerometer bias) are two real pairs of their own. docs/theory/phasor.md
#ifndef LEVELHEAD_PHASOR_HPP
#define LEVELHEAD_PHASOR_HPP

#include "earth.hpp"
#include "phasor_model.hpp"
#include "platform.hpp"
#include "settled.hpp"

namespace levelhead {

template <class S>
struct PhasorParams {
    PlatformParams<S> platform;  // of which tau and tau_heading are not used
    PhasorNoise<S> noise;
    S velocity_std;                // where the fix tells none, m/s
    S sideslip_std;                // between course and heading, rad; it stays for sideslip_time
    S axle_std;                    // how far the IMU can be from where course and heading agree in a turn, m
    S initial_gyro_bias_std, initial_accel_bias_std;
    S latitude;                    // rad; NaN: unknown, then the Earth's rotation is not compensated
    S gravity_std;                 // shown in the sigma of the vertical accelerometer bias only, m/s^2
};

// A little below one second, so that float and double agree on when a second of samples is over.
constexpr double longest_step = 0.999;         // the covariance moves at least this often, s ...
constexpr double largest_turn = 0.35;          // ... and at least once per such a turn: within it the rate counts as even, rad
// An unknown heading has no variance; this one is large enough that the first course says nothing about the gyro bias, however
// long the vehicle has stood before, rad^2.
constexpr double unknown_heading_var = 1e6;
constexpr double least_velocity_std = 1e-4, most_velocity_std = 1e3;  // what a fix may claim of itself, m/s

constexpr double gate_pair = 16.0;     // squared normalised horizontal innovation: one in 3000 is above it by chance
constexpr double gate_one = 14.0;      // the same for one real innovation: one in 5000
constexpr double sideslip_time = 2.0;  // how long a sideslip stays, s

// Listens to the filter; this one does nothing and costs nothing.
struct NoRecorder {
    template <class Filter, class S>
    void moved(const Filter&, const Transition<S>&, const Complex<S>&, S, bool) {}
    template <class S>
    void corrected(const PhasorVector<S>&, const HeadingGain<S>&, S, const Complex<S>&) {}
    template <class S>
    void turned(const PairGain<S>&, S, S) {}
    template <class S>
    void lifted(const PairGain<S>&, S, S) {}
    template <class Filter>
    void done(const Filter&) {}
};

// Variances in the level frame, horizontal (the same for all directions) and vertical, as sigmas of what is shown.
template <class S>
Sigma<S> level_sigma(const Vec3<S>& down_body, S gyro, S gyro_down, S accel, S accel_down, S tilt, S heading) {
    const Vec3<S>& d = down_body;
    const auto body = [&](S level, S down) {
        const auto axis = [&](S z) { return square_root(level + (down - level) * z * z); };
        return Vec3<S>{axis(d.x), axis(d.y), axis(d.z)};
    };
    const S cos2 = maximum(S(1) - d.x * d.x, S(1e-6));  // of the pitch
    return {body(gyro, gyro_down), body(accel, accel_down),
            {square_root(tilt / cos2), square_root(tilt), square_root(heading + tilt * d.x * d.x / cos2)}};
}

template <class S, class Recorder = NoRecorder>
struct Phasor {
    using Scalar = S;
    using Params = PhasorParams<S>;
    static constexpr bool vertical_accel_bias = true;

    PlatformState<S> platform;  // its velocity_ned and delta_velocity are the filter's own
    Vec3<S> gyro_bias, accel_bias;
    PhasorCovariance<S> horizontal;
    PairCovariance<S> turning, lifting;  // heading & vertical gyro bias; vertical velocity & accelerometer bias
    HeadingShare<S> share;               // of the first pair's errors in the four, on top of their covariance
    Complex<S> azimuth;                  // e^{i alpha}: the level frame's x axis in North + i East
    S elapsed;                           // since the covariance moved, s
    S gap_tilt, gap_velocity;            // variances to add for bridged IMU gaps
    S yaw_rate;                          // over the last interval, rad/s
    S turned;                            // integral of the squared yaw rate, rad^2/s
    S surprise, surprises;               // mean of the squared normalised innovations, and how many went into it
    S gravity_var;
    Recorder recorder;

    void begin(const Params& k) {
        const S g = k.initial_gyro_bias_std * k.initial_gyro_bias_std, a = k.initial_accel_bias_std * k.initial_accel_bias_std;
        horizontal.gg = turning.bb = g;
        horizontal.aa = lifting.bb = a;
        turning.xx = S(unknown_heading_var);
        azimuth = {S(1), S(0)};
        surprise = S(1);
        gravity_var = k.gravity_std * k.gravity_std;
    }

    // The biases have wandered on while nobody looked.
    void restart(const Params& k, const Vec3<S>& specific_force, S lost) {
        levelhead::restart(platform, specific_force);
        horizontal.gg = horizontal.gg + k.noise.gyro_walk * lost;
        turning.bb = turning.bb + k.noise.gyro_walk * lost;
        horizontal.aa = horizontal.aa + k.noise.accel_walk * lost;
        lifting.bb = lifting.bb + k.noise.accel_walk * lost;
    }

    void bridged(S gap, const Vec3<S>& gyro_change, const Vec3<S>& accel_change) {
        const HiddenMotion<S> hidden = hidden_motion(gap, gyro_change, accel_change);
        gap_tilt = gap_tilt + hidden.tilt;
        gap_velocity = gap_velocity + hidden.velocity;
    }

    LEVELHEAD_HOT void step(const Params&, S dt, const Vec3<S>& gyro, const Vec3<S>& accel) {
        advance(platform, dt, gyro - gyro_bias, accel - accel_bias, platform.dcm_body_to_ned.z);
        elapsed = elapsed + dt;
    }

    // Within a long interval, or a sharp turn, the covariance moves without waiting for the epoch.
    LEVELHEAD_HOT void tick(const Params& k) {
        if ((elapsed >= S(longest_step) || absolute(platform.turn) > S(largest_turn)) && platform.aligned > S(0.5)) {
            move(k);
            recorder.done(*this);
        }
    }

    double longest(const Params&) const { return max_interval; }

    Vec3<S> velocity(const Params& k, S) const {
        return current_velocity(platform, k.platform.gravity, elapsed);
    }

    Interval<S> epoch(const Params& k, const Fix<S>& fix) {
        Interval<S> out{};
        out.length = fix.length;
        if (platform.aligned > S(0.5)) move(k);
        // The level frame's x axis, seen from the body: it stays there while the platform is turned to the first course.
        const Vec3<S> axis = transposed_times(platform.dcm_body_to_ned, {azimuth.re, azimuth.im, S(0)});
        const S heading_before = heading(platform.dcm_body_to_ned);
        const Sighting<S> e = sight(platform, k.platform, fix);
        out.waiting = select(e.waiting, S(1), S(0));
        if (e.was_aligned) {
            if (e.turned_now) {
                azimuth = {dot(platform.dcm_body_to_ned.x, axis), dot(platform.dcm_body_to_ned.y, axis)};
                take_course(k, e, fix, wrap_angle(heading(platform.dcm_body_to_ned) - heading_before));
            }
            // Without a heading the accelerations of a moving vehicle have no direction: take the velocity, learn nothing.
            if (e.knew_heading || e.at_rest) {
                correct(k, e, fix);
            } else {
                recorder.done(*this);
                take_velocity(k, e.velocity, fix);
            }
        } else if (e.aligned_now) {
            align_covariance(k, e, fix);
        }
        begin_interval(platform, e, platform.aligned > S(0.5) ? platform.velocity_ned : e.velocity);
        if (e.was_aligned || e.aligned_now) recorder.done(*this);
        return out;
    }

    uint32_t settled() const {
        return settled_bits(square_root(horizontal.gg), square_root(horizontal.aa), square_root(turning.bb),
                            square_root(turning.xx), turned > S(enough_turning));
    }

    Sigma<S> sigma() const {
        const S any_angle = S(pi * pi), heading = platform.heading_known > S(0.5) ? turning.xx : any_angle;
        Sigma<S> out = level_sigma(platform.dcm_body_to_ned.z, horizontal.gg + shared_variance(turning, share.x.g, share.b.g), turning.bb,
                           horizontal.aa + shared_variance(turning, share.x.a, share.b.a), lifting.bb + gravity_var,
                           horizontal.tt + shared_variance(turning, share.x.t, share.b.t), heading);
        if (!(platform.aligned > S(0.5))) out.attitude = {S(pi), S(pi), S(pi)};
        return out;
    }

  private:
    // Bring velocity and covariance up to now.
    void move(const Params& k) {
        PlatformState<S>& p = platform;
        const S t = elapsed, phi = p.turn;
        // What carries the tilt into the velocity is the mean vertical force; a bump moves it, bad data must not.
        const S force = t > S(0) ? clamp(-p.delta_velocity.z / t, S(0.5) * k.platform.gravity, S(2) * k.platform.gravity) : k.platform.gravity;
        const Vec3<S> dv = p.delta_velocity;
        p.velocity_ned = p.velocity_ned + dv + Vec3<S>{S(0), S(0), k.platform.gravity * t};
        feel_the_earth(k, t);
        turn_azimuth(phi);
        const Transition<S> f = transition(t, phi, force);
        propagate(horizontal, f);
        // A heading that is not known has no small error that could be estimated.
        Complex<S> push = {S(0), S(0)};
        if (p.heading_known > S(0.5)) push = times_i(to_level(dv.x, dv.y));
        propagate(turning, share, horizontal, f, push, t, k.noise.gyro * t + gap_tilt, k.noise.gyro_walk);
        add_noise(horizontal, k.noise, t, force);
        horizontal.tt = horizontal.tt + gap_tilt;
        horizontal.nn = horizontal.nn + gap_velocity;
        propagate(lifting, t, k.noise.accel, k.noise.accel_walk);
        lifting.xx = lifting.xx + gap_velocity;
        // A tick may have come at the very epoch: nothing has moved since, and the yaw rate is still what it was.
        if (t > S(0)) {
            yaw_rate = phi / t;
            turned = minimum(turned + phi * yaw_rate, S(1e3));
        }
        recorder.moved(*this, f, push, t, false);
        elapsed = gap_tilt = gap_velocity = p.turn = S(0);
        p.delta_velocity = {S(0), S(0), S(0)};
    }

    void turn_azimuth(S angle) {
        const RotationCoefficients<S> r = rotation_coefficients(angle * angle);
        const Complex<S> u = azimuth * Complex<S>{S(1) - angle * angle * r.b, angle * r.a};
        azimuth = u * (S(1.5) - S(0.5) * norm2(u));  // one Newton step towards |u| = 1
    }

    // Coriolis acceleration over the time t, and the rate for the platform to turn at from here on. Before the heading is
    // known nobody knows where North is, and only the vertical part can be taken off.
    void feel_the_earth(const Params& k, S t) {
        const FrameRate<S> rate = frame_rate(k.latitude, platform.velocity_ned);
        const auto known = platform.heading_known > S(0.5);
        platform.velocity_ned = platform.velocity_ned - cross(rate.coriolis, platform.velocity_ned) * select(known, t, S(0));
        platform.control_rate_ned = select(known, rate.turn, Vec3<S>{S(0), S(0), rate.turn.z});
        platform.hold = S(1e9);
    }

    S velocity_variance(const Params& k, S std) const {
        const S known = std == std ? clamp(std, S(least_velocity_std), S(most_velocity_std)) : k.velocity_std;
        return known * known;
    }

    Complex<S> to_level(S north, S east) const { return conj(azimuth) * Complex<S>{north, east}; }

    // After levelling, what the accelerometers read amiss is in the tilt: theta = i (mean of beta_a - dn/T) / g, plus what the
    // gyro bias has turned since. In a turn the mean of a bias is not the bias: the integrals are those of a transition.
    void align_covariance(const Params& k, const Sighting<S>& e, const Fix<S>& fix) {
        PhasorCovariance<S>& p = horizontal;
        const S over_g = S(1) / k.platform.gravity, half = S(0.5) * fix.length;
        const Transition<S> through = transition(fix.length, platform.turn, k.platform.gravity);
        const S r = velocity_variance(k, horizontal_std(fix.std));
        azimuth = {S(1), S(0)};
        yaw_rate = platform.turn * e.rate;
        platform.turn = elapsed = gap_tilt = gap_velocity = S(0);
        platform.velocity_ned = e.velocity;
        feel_the_earth(k, S(0));
        Transition<S> f{};
        f.tg = times_i(conj(through.ng * conj(through.nn))) * (over_g * e.rate);
        f.ta = times_i(through.na) * (over_g * e.rate);
        p.nn = S(0);
        p.nt = p.ng = p.na = {S(0), S(0)};
        p.tt = S(0);
        p.tg = p.ta = {S(0), S(0)};
        propagate(p, f);
        turning.xx = e.trusted ? course_variance(k, e, fix, S(1)) : S(unknown_heading_var);
        turning.xb = S(0);
        // Levelling on an acceleration seen from a wrong heading tilts the platform: theta = -f psi / g.
        const Complex<S> lean = Complex<S>{e.gnss_force.x, e.gnss_force.y} * -over_g;
        p.tt = p.tt + (S(2) * r * e.rate * e.rate + k.noise.accel * e.rate) * over_g * over_g + k.noise.gyro * half +
               (e.trusted ? S(0) : norm2(lean));
        p.nn = r;
        p.nt = {S(0), r * e.rate * over_g};
        share = HeadingShare<S>{};
        if (e.trusted) share.x.t = lean;
        recorder.moved(*this, f, {S(0), S(0)}, fix.length, true);
        lifting.xx = velocity_variance(k, fix.std.z);
        lifting.xb = S(0);
    }

    // One look at the course: velocity noise, and how much the vehicle slides or swings. That stays for a while, so that
    // many looks tell no more about it than one.
    S course_variance(const Params& k, const Sighting<S>& e, const Fix<S>& fix, S looks) const {
        const S sliding = k.sideslip_std * k.sideslip_std + k.axle_std * k.axle_std * yaw_rate * yaw_rate / e.speed2;
        return velocity_variance(k, horizontal_std(fix.std)) / e.speed2 + sliding * looks;
    }

    void take_velocity(const Params& k, const Vec3<S>& velocity, const Fix<S>& fix) {
        Transition<S> f{};
        f.tt = {S(1), S(0)};
        propagate(horizontal, f);
        horizontal.nn = velocity_variance(k, horizontal_std(fix.std));
        lifting.xx = velocity_variance(k, fix.std.z);
        lifting.xb = S(0);
        platform.velocity_ned = velocity;
        share.x.n = share.b.n = {S(0), S(0)};
        recorder.moved(*this, f, {S(0), S(0)}, S(0), false);
    }

    // The first course; `angle` is what sight() has turned the heading by.
    void take_course(const Params& k, const Sighting<S>& e, const Fix<S>& fix, S angle) {
        const S r = course_variance(k, e, fix, S(1)), s = turning.xx + r;
        recorder.turned(measure(turning, r), s, -angle);
        share = HeadingShare<S>{};
        // Until now the Earth's horizontal rate had no direction and went into the gyro bias.
        const Vec3<S> turn = frame_rate(k.latitude, platform.velocity_ned).turn;
        horizontal.gg = horizontal.gg + S(0.5) * (turn.x * turn.x + turn.y * turn.y);
    }

    // A level-frame bias (horizontal, down) as seen by the body's axes.
    void add_bias(Vec3<S>& bias, const Complex<S>& level, S down) const {
        const Complex<S> ned = azimuth * level;
        bias = bias + transposed_times(platform.dcm_body_to_ned, {ned.re, ned.im, down});
    }

    // Innovations beyond what chance allows are outliers: all of the fix is then trusted so much less that the worst of them
    // becomes just possible. A filter that is wrong itself is still pulled, by a few sigma per epoch.
    static S doubt(const Complex<S>& z, S s, S down, S s_down, S course, S s_course) {
        const S worst = maximum(S(1.0 / gate_pair) * norm2(z) / s,
                                S(1.0 / gate_one) * maximum(down * down / s_down, course * course / s_course));
        return maximum(worst, S(1));
    }

    void correct(const Params& k, const Sighting<S>& e, const Fix<S>& fix) {
        PlatformState<S>& p = platform;
        const Vec3<S> error = p.velocity_ned - e.velocity;
        const Complex<S> z = to_level(error.x, error.y);
        const auto steer = e.knew_heading & e.trusted;
        const S innovation = steer ? -course_innovation(p, steer, e.course) : S(0);
        const S r = velocity_variance(k, horizontal_std(fix.std)), r_down = velocity_variance(k, fix.std.z);
        const S looks = maximum(S(1), S(2.0 * sideslip_time) * e.rate);
        const S r_course = steer ? course_variance(k, e, fix, looks) : S(1);
        const S plain = horizontal.nn + r + shared_variance(turning, share.x.n, share.b.n);
        const S f = doubt(z, plain, error.z, lifting.xx + r_down, innovation, turning.xx + r_course);
        surprises = minimum(surprises + S(1), S(1e5));
        surprise = surprise + (S(0.5) * norm2(z) / (plain * f) - surprise) / surprises;

        const S s = f * (horizontal.nn + r);
        const PhasorVector<S> gain = measure_velocity(horizontal, s);
        const HeadingGain<S> aside = measure_velocity(turning, share, gain, s);
        recorder.corrected(gain, aside, s, z);
        S turn = inner(aside.x, z), turn_bias = inner(aside.b, z);

        const S lifted_r = r_down * f + (f - S(1)) * lifting.xx, s_down = f * (lifting.xx + r_down);
        const PairGain<S> lift = measure(lifting, lifted_r);
        recorder.lifted(lift, s_down, error.z);

        if (steer) {
            const S y = innovation - turn, r_doubted = r_course * f + (f - S(1)) * turning.xx, s_course = f * (turning.xx + r_course);
            const PairGain<S> steered = measure(turning, r_doubted);
            recorder.turned(steered, s_course, y);
            turn = turn + steered.x * y;
            turn_bias = turn_bias + steered.b * y;
        }

        // The four give up what the pair had put into them.
        const PhasorVector<S> x = gain * z + share.x * turn + share.b * turn_bias;
        const Complex<S> nu = azimuth * x.n, theta = azimuth * x.t;
        p.velocity_ned = p.velocity_ned - Vec3<S>{nu.re, nu.im, lift.x * error.z};
        add_bias(gyro_bias, x.g, turn_bias);
        add_bias(accel_bias, x.a, lift.b * error.z);
        p.dcm_body_to_ned = rotated_in_ned(p.dcm_body_to_ned, {-theta.re, -theta.im, -turn});
        turn_azimuth(-turn);
    }
};

}  // namespace levelhead

#endif
