// How sure the papers' fixed-gain estimators can be of what they show: the second moments of their errors, carried from
// epoch to epoch with THEIR gains (not with optimal ones) and the noises of the sensors.
//
// A horizontal vector is one complex number x + iy in the level frame that turns with the vehicle. With theta the tilt of
// the platform (estimate - truth) and beta the biases still left in the compensated readings, Eqs. (1)-(3) become
//     theta' = -i w_z theta + beta_g - w_p,    d = -(i g theta + beta_a) + noise,    w_p = i k d,
// the same for both axes, so that variances are per axis, E|x|^2 / 2. Two things are remembered from one interval to the
// next: w_p, which acts over the interval after the one that measured it, and the GNSS noise of the epoch between them,
// which enters both velocity increments with opposite signs.
#ifndef LEVELHEAD_COVARIANCE_HPP
#define LEVELHEAD_COVARIANCE_HPP

#include "complex.hpp"
#include "observer.hpp"
#include "two_stage.hpp"

namespace levelhead {

// A turn about the vertical.
template <class S>
Complex<S> polar(S angle) { return {cosine(angle), sine(angle)}; }

// What is random; densities are one-sided, so white noise of density d grows an integral's variance by d^2 / 2 per second.
template <class S>
struct Noise {
    S gyro, accel;                  // densities, rad/s/sqrt(Hz), m/s^2/sqrt(Hz)
    S gyro_walk, accel_walk;        // rad/s/sqrt(s), m/s^2/sqrt(s)
    S velocity;                     // sigma where a fix has none, m/s
    S initial_gyro, initial_accel;  // sigmas before the drive, rad/s, m/s^2
};

// Second moments of N complex errors about their means, and the means.
template <class S, int N>
struct Moments {
    Complex<S> p[N][N];  // E x_j conj(x_k) / 2
    Complex<S> mean[N];

    // x_i <- sum of c_j x_j, the only thing that ever happens to errors in a linear loop.
    void combine(int i, const Complex<S> (&c)[N]) {
        Complex<S> row[N] = {};
        Complex<S> value{S(0), S(0)};
        S own = S(0);
        for (int j = 0; j < N; ++j) {
            if (c[j].re == S(0) && c[j].im == S(0)) continue;  // most are
            for (int k = 0; k < N; ++k) row[k] = row[k] + c[j] * p[j][k];
            value = value + c[j] * mean[j];
        }
        for (int k = 0; k < N; ++k) own = own + inner(row[k], c[k]);
        for (int k = 0; k < N; ++k) {
            p[i][k] = row[k];
            p[k][i] = conj(row[k]);
        }
        p[i][i] = {own, S(0)};
        mean[i] = value;
    }

    // Independent noise: x_i gains a_i e and x_k gains a_k e with E|e|^2 / 2 = variance; give a_k = 0 for i alone.
    void disturb(int i, Complex<S> a_i, int k, Complex<S> a_k, S variance) {
        p[i][i].re = p[i][i].re + norm2(a_i) * variance;
        p[k][k].re = p[k][k].re + norm2(a_k) * variance;
        const Complex<S> cross = a_i * conj(a_k) * variance;
        p[i][k] = p[i][k] + cross;
        p[k][i] = p[k][i] + conj(cross);
    }

    void disturb(int i, S variance) { p[i][i].re = p[i][i].re + variance; }

    void forget(int i) {
        const Complex<S> none[N] = {};
        combine(i, none);
    }

    S deviation(int i) const { return square_root(maximum(p[i][i].re, S(0)) + S(0.5) * norm2(mean[i])); }
};

// What one closed interval does to the estimates: each gains so much times the control rate, seen from the level frame at
// the interval's end. `reads` is 1 where the black-box low-pass of that bias takes a step, of the size given.
template <class S>
struct Gains {
    Complex<S> gyro, accel;
    S vertical;
    S gyro_step, accel_step, vertical_step;  // black box only
    S read_rate;                             // 1 / w_z of the closed form, s/rad
    bool open;
};

// The body sees w_p from the mean of its attitudes at both ends: (1 + e^{i phi}) / 2 in the frame of the later one.
template <class S>
Complex<S> mean_view(S turn) {
    return polar(S(0.5) * turn) * cosine(S(0.5) * turn);
}

template <class S>
Gains<S> gains(const ObserverParams<S>& k, const Interval<S>& i) {
    const Complex<S> view = mean_view(i.turn);
    const S time = i.length * i.learn;
    const S yaw_rate = clamp(i.yaw_rate, S(-max_gain_rate), S(max_gain_rate));
    Gains<S> out{};
    out.gyro = view * (time / k.tau_gyro);
    out.accel = view * (k.platform.gravity * yaw_rate * time / k.omega_accel);
    out.vertical = i.steered * i.length / k.tau_gyro;
    return out;
}

template <class S>
Gains<S> gains(const TwoStageParams<S>& k, const Interval<S>& i) {
    const Complex<S> view = mean_view(i.turn);
    const S rate = absolute(i.yaw_rate);
    const bool straight = rate < k.straight_rate, turning = rate > k.turn_rate;
    Gains<S> out{};
    out.gyro_step = straight ? i.learn * minimum(S(1), i.length / k.tau_gyro_lowpass) : S(0);
    out.accel_step = turning ? i.learn * minimum(S(1), i.length / k.tau_accel_lowpass) : S(0);
    out.vertical_step = i.steered * out.gyro_step;
    out.read_rate = turning ? S(1) / i.yaw_rate : S(0);
    out.open = k.feedback == 0;
    out.gyro = view * out.gyro_step;
    out.accel = view * Complex<S>{out.read_rate, k.platform.tau} * (k.platform.gravity * out.accel_step);
    out.vertical = out.vertical_step;
    return out;
}

// One sigma in the level frame, and what lets tilt and heading grow when nothing corrects them any more.
template <class S>
struct LevelSigma {
    S tilt, gyro, accel;             // per horizontal axis
    S heading, vertical_gyro;
    S tilt_growth, tilt_rate;        // covariance of tilt with the rate that is left in it, sigma of that rate
    S heading_growth, heading_rate;  // the same for heading
    S tilt_control, control;         // covariance of tilt with the control rate that follows, sigma of the latter
    S heading_control, steer;        // the same for heading
    Complex<S> tilt_mean, gyro_mean, accel_mean;  // the part of the errors that the known leak makes, within the sigmas
};

// The recursion. With feedback beta is truth - estimate; in the black box the platform sees the whole bias, and what the
// low-passes have not yet found of it is a state of its own.
template <class S, bool Open>
struct FixedGainCovariance {
    enum { TILT, GYRO, ACCEL, CONTROL, GNSS, GYRO_LEFT, ACCEL_LEFT };
    enum { HEADING, VERTICAL, STEER, VERTICAL_LEFT };

    Moments<S, Open ? 7 : 5> level;
    Moments<S, Open ? 4 : 3> upright;
    S hold;  // how long the control rate still acts, s
    bool aligned, heading_known;

    static constexpr int gyro_error = Open ? int(GYRO_LEFT) : int(GYRO);
    static constexpr int accel_error = Open ? int(ACCEL_LEFT) : int(ACCEL);
    static constexpr int vertical_error = Open ? int(VERTICAL_LEFT) : int(VERTICAL);

    static FixedGainCovariance make(const Noise<S>& noise) {
        FixedGainCovariance c{};
        const Complex<S> one{S(1), S(0)};
        const S gyro = noise.initial_gyro * noise.initial_gyro, accel = noise.initial_accel * noise.initial_accel;
        c.common(c.level, GYRO, gyro_error, gyro, one);
        c.common(c.level, ACCEL, accel_error, accel, one);
        c.common(c.upright, VERTICAL, vertical_error, gyro, one);
        return c;
    }

    // One epoch, `elapsed` after the one before; `leak` is a known horizontal acceleration error, m/s^2.
    void epoch(const PlatformParams<S>& k, const Gains<S>& g, const Noise<S>& noise, const Interval<S>& i, S elapsed,
               Complex<S> leak) {
        const Complex<S> one{S(1), S(0)};
        const S sigma = i.velocity_std == i.velocity_std ? i.velocity_std : noise.velocity;
        const S gyro_q = S(0.5) * noise.gyro * noise.gyro;
        common(level, GYRO, gyro_error, noise.gyro_walk * noise.gyro_walk * elapsed, one);
        common(level, ACCEL, accel_error, noise.accel_walk * noise.accel_walk * elapsed, one);
        common(upright, VERTICAL, vertical_error, noise.gyro_walk * noise.gyro_walk * elapsed, one);
        const bool now_aligned = i.aligned > S(0.5), now_headed = i.heading_known > S(0.5);
        if (now_aligned && !aligned)
            level_out(k, noise, i, sigma, gyro_q, leak);
        else if (now_aligned)
            tilt(k, g, noise, i, sigma, gyro_q, leak);
        steer(k, g, i, elapsed, sigma, gyro_q, now_headed && !heading_known);
        hold = i.length;
        aligned = now_aligned;
        heading_known = now_headed;
    }

    LevelSigma<S> sigma() const {
        LevelSigma<S> s;
        const S unknown = S(NAN);
        s.gyro = level.deviation(gyro_error);
        s.accel = level.deviation(accel_error);
        s.vertical_gyro = upright.deviation(vertical_error);
        s.tilt = aligned ? level.deviation(TILT) : unknown;
        s.heading = heading_known ? upright.deviation(HEADING) : unknown;
        s.tilt_growth = level.p[TILT][GYRO].re;
        s.heading_growth = upright.p[HEADING][VERTICAL].re;
        s.tilt_rate = level.deviation(GYRO);
        s.heading_rate = upright.deviation(VERTICAL);
        s.tilt_control = level.p[TILT][CONTROL].re;
        s.control = level.deviation(CONTROL);
        s.heading_control = upright.p[HEADING][STEER].re;
        s.steer = upright.deviation(STEER);
        s.tilt_mean = level.mean[TILT];
        s.gyro_mean = level.mean[gyro_error];
        s.accel_mean = level.mean[accel_error];
        return s;
    }

  private:
    // Noise that a bias and its error have in common; one state with feedback.
    template <class M>
    static void common(M& m, int bias, int error, S variance, Complex<S> one) {
        if (Open)
            m.disturb(bias, one, error, one, variance);
        else
            m.disturb(bias, variance);
    }

    // Over an interval that turns by phi: the mean of e^{-i (what is still to turn)}, and the same weighted by the time left,
    // which is how a rate enters the mean angle.
    static Complex<S> turned_mean(S phi) {
        const S half = S(0.5) * phi;
        const S sinc = absolute(half) > S(1e-3) ? sine(half) / half : S(1) - half * half * S(1.0 / 6);
        return polar(-half) * sinc;
    }
    static Complex<S> turned_ramp(S phi) {
        if (absolute(phi) < S(0.02)) return polar(phi * S(-2.0 / 3)) * (S(1) - phi * phi * S(1.0 / 36));
        const Complex<S> end = polar(-phi), x = end + times_i(end) * phi - Complex<S>{S(1), S(0)};
        return x * (S(2) / (phi * phi));
    }

    // The platform has just been levelled: i g theta_mean + beta_a is the noise of one velocity increment.
    void level_out(const PlatformParams<S>& k, const Noise<S>& noise, const Interval<S>& i, S sigma, S gyro_q, Complex<S> leak) {
        const S length = maximum(i.length, S(1e-6)), g = k.gravity;
        const Complex<S> up{S(0), S(1) / g};
        Complex<S> c[sizeof level.mean / sizeof *level.mean] = {};
        c[ACCEL] = up * turned_mean(i.turn);
        // The gyro turns the platform on from its mean attitude in the interval to that at the end.
        c[GYRO] = turned_mean(i.turn) * length - turned_ramp(i.turn) * (S(0.5) * length);
        level.combine(TILT, c);
        level.mean[TILT] = level.mean[TILT] + up * leak;
        level.forget(CONTROL);
        level.forget(GNSS);
        const S n2 = sigma * sigma;
        level.disturb(TILT, n2 / (length * length * g * g));  // of the interval's first epoch
        level.disturb(TILT, up * (S(-1) / length), GNSS, {S(1), S(0)}, n2);
        level.disturb(TILT, S(0.5) * noise.accel * noise.accel / (length * g * g) + gyro_q * length * S(1.0 / 3));
    }

    void tilt(const PlatformParams<S>& k, const Gains<S>& gain, const Noise<S>& noise, const Interval<S>& i, S sigma, S gyro_q,
              Complex<S> leak) {
        constexpr int n = Open ? 7 : 5;
        const S length = maximum(i.length, S(1e-6)), rate = S(1) / length, g = k.gravity;
        const S held = minimum(hold, length);
        const Complex<S> turn = polar(-i.turn), one{S(1), S(0)};
        const Complex<S> mean = turned_mean(i.turn), ramp = turned_ramp(i.turn);

        Complex<S> c[n] = {};
        c[TILT] = turn;
        c[CONTROL] = turn * -held;
        c[GYRO] = mean * length;
        level.combine(TILT, c);
        if (!(i.level > S(0.5))) {
            level.disturb(TILT, gyro_q * length);
            level.forget(CONTROL);
            level.forget(GNSS);
            level.disturb(GNSS, sigma * sigma);
            return;
        }

        // w_p = i k d, d from the mean tilt: that at the end, less what was still to come of control, bias and noise.
        const S gain_k = minimum(S(1) / k.tau, rate) / g;
        const Complex<S> ik{S(0), gain_k};
        Complex<S> w[n] = {};
        w[TILT] = one * (g * gain_k);
        w[CONTROL] = turn * (g * gain_k * held * held * S(0.5) * rate);
        w[GYRO] = (ramp * S(0.5) - mean) * (g * gain_k * length);
        w[ACCEL] = -(ik * mean);
        w[GNSS] = -(ik * turn * rate);
        level.combine(CONTROL, w);
        level.mean[CONTROL] = level.mean[CONTROL] - ik * leak;
        // Gyro noise: half of the interval's sum reaches the mean tilt, and a twelfth of its variance on its own.
        level.disturb(TILT, one, CONTROL, one * (S(0.5) * g * gain_k), gyro_q * length);
        level.disturb(CONTROL, g * g * gain_k * gain_k * gyro_q * length * S(1.0 / 12));
        level.disturb(CONTROL, S(0.5) * noise.accel * noise.accel * rate * gain_k * gain_k);
        level.forget(GNSS);
        level.disturb(CONTROL, ik * rate, GNSS, one, sigma * sigma);
        if constexpr (Open)
            read(gain, k.gravity, k.tau, i.turn);
        else
            learn(gain);
    }

    void learn(const Gains<S>& gain) {
        Complex<S> c[sizeof level.mean / sizeof *level.mean] = {};
        c[GYRO] = {S(1), S(0)};
        c[CONTROL] = -gain.gyro;
        level.combine(GYRO, c);
        c[GYRO] = {S(0), S(0)};
        c[ACCEL] = {S(1), S(0)};
        c[CONTROL] = -gain.accel;
        level.combine(ACCEL, c);
    }

    // The black box: b_hat follows the closed form, so what is left of the bias, b - b_hat, loses a step of (form - b_hat).
    void read(const Gains<S>& gain, S g, S tau, S turn) {
        constexpr int n = Open ? 7 : 5;
        const Complex<S> view = mean_view(turn);
        const S a = gain.accel_step, b = gain.gyro_step;
        Complex<S> c[n] = {};
        c[ACCEL_LEFT] = {S(1) - a, S(0)};
        c[ACCEL] = {a, S(0)};
        c[CONTROL] = view * Complex<S>{gain.read_rate, tau} * (-g * a);
        c[GYRO] = {g * a * gain.read_rate, S(0)};
        c[GYRO_LEFT] = {-g * a * gain.read_rate, S(0)};
        level.combine(ACCEL_LEFT, c);
        Complex<S> e[n] = {};
        e[GYRO_LEFT] = {S(1) - b, S(0)};
        e[GYRO] = {b, S(0)};
        e[CONTROL] = view * -b;
        level.combine(GYRO_LEFT, e);
    }

    // Heading error and what is left of the vertical gyro bias: real numbers, the same algebra.
    void steer(const PlatformParams<S>& k, const Gains<S>& gain, const Interval<S>& i, S elapsed, S sigma, S gyro_q, bool first) {
        constexpr int n = Open ? 4 : 3;
        const S length = maximum(elapsed, S(1e-6));
        const S course = sigma / maximum(i.speed, S(1e-3));
        if (first) {
            upright.forget(HEADING);
            upright.forget(STEER);
            upright.disturb(HEADING, course * course);
            return;
        }
        const S held = minimum(hold, length);
        Complex<S> c[n] = {};
        c[HEADING] = {S(1), S(0)};
        c[VERTICAL] = {length, S(0)};
        c[STEER] = {-held, S(0)};
        upright.combine(HEADING, c);
        upright.disturb(HEADING, gyro_q * length);
        const S steer_gain = i.steered * minimum(S(1) / k.tau_heading, S(1) / length);
        Complex<S> w[n] = {};
        w[HEADING] = {steer_gain, S(0)};
        upright.combine(STEER, w);
        upright.disturb(STEER, steer_gain * steer_gain * course * course);
        Complex<S> e[n] = {};
        if constexpr (Open) {
            e[VERTICAL_LEFT] = {S(1) - gain.vertical_step, S(0)};
            e[VERTICAL] = {gain.vertical_step, S(0)};
        } else {
            e[VERTICAL] = {S(1), S(0)};
        }
        e[STEER] = {-gain.vertical, S(0)};
        upright.combine(vertical_error, e);
    }
};

}  // namespace levelhead

#endif
