// The bias observer of Tereshkov (2015), Eqs. (10)-(12): both biases driven by the control rate.
#ifndef LEVELHEAD_OBSERVER_HPP
#define LEVELHEAD_OBSERVER_HPP

#include "fixed_gain.hpp"

namespace levelhead {

template <class S>
struct ObserverParams {
    PlatformParams<S> platform;
    S tau_gyro;      // tau_g, s
    S omega_accel;   // omega_a, rad/s
    uint32_t paper_gain;  // 1: Eq. (12) to the letter, body w_z; 0: the general gain, valid on slopes and upside-down
};

constexpr double max_gain_rate = 2.0;  // |w_z| in the accelerometer bias gain is clamped to this, rad/s

template <class S>
struct Observer : FixedGain<S> {
    using Scalar = S;
    using Params = ObserverParams<S>;

    using FixedGain<S>::platform;
    using FixedGain<S>::gyro_bias;
    using FixedGain<S>::accel_bias;
    using FixedGain<S>::excitation;

    LEVELHEAD_HOT void step(const Params& k, S dt, const Vec3<S>& gyro, const Vec3<S>& accel) {
        const Vec3<S> body_z = {S(0), S(0), S(1)};
        const Vec3<S> vertical = k.paper_gain ? body_z : platform.dcm_body_to_ned.z;
        advance(platform, dt, gyro - gyro_bias, accel - accel_bias, vertical);
    }

    Interval<S> epoch(const Params& k, const Fix<S>& fix) {
        const Interval<S> i = close_interval(platform, k.platform, fix);
        learn(k, i);
        return i;
    }

    void learn(const Params& k, const Interval<S>& i) {
        const S yaw_rate = clamp(i.yaw_rate, S(-max_gain_rate), S(max_gain_rate));
        const S time = i.length * i.learn;
        // Eq. (11). The vertical component learns from the course by the same rule.
        const Vec3<S> heading_share = i.control_rate_body - i.control_rate_body_level;
        gyro_bias = gyro_bias + (i.control_rate_body_level * time + heading_share * i.length) * (S(1) / k.tau_gyro);
        // Eq. (12). The general gain ([w_b x][k_b x])^T u, with k_b = C^T k and w_b along down, is the vertical rate times
        // the part of u across down; the paper's is the body's w_z times the x and y of u.
        Vec3<S> u = i.control_rate_body_level;
        if (k.paper_gain) {
            u.z = S(0);
        } else {
            // An IMU that turns over within one interval has no mean vertical; such a one must not divide by zero.
            const S length2 = maximum(dot(i.down_body, i.down_body), S(1e-3));
            u = u - i.down_body * (dot(i.down_body, u) / length2);
        }
        accel_bias = accel_bias + u * (k.platform.gravity * yaw_rate * time / k.omega_accel);

        const S slow = slow_yaw_rate(excitation, yaw_rate, i.length, k.platform.tau);
        const S lag = slow * k.platform.tau;
        excite(excitation, square_root(time / k.tau_gyro),
               slow * square_root(time / (k.omega_accel * (S(1) + lag * lag))), i.length * i.steered / k.tau_gyro);
    }

    uint32_t settled() const { return excitation_status(excitation); }
};

}  // namespace levelhead

#endif
