// The two-stage estimator of Tereshkov (2013): the virtual platform's steady control rate, read in closed form, is the
// gyro bias on straights (Eq. 12) and gives the accelerometer bias in turns (Eq. 14), each through a first-order low-pass.
#ifndef LEVELHEAD_TWO_STAGE_HPP
#define LEVELHEAD_TWO_STAGE_HPP

#include "fixed_gain.hpp"

namespace levelhead {

template <class S>
struct TwoStageParams {
    PlatformParams<S> platform;
    S tau_gyro_lowpass;   // s
    S tau_accel_lowpass;  // s
    S straight_rate;      // below this |yaw rate| the gyro bias is read, rad/s
    S turn_rate;          // above this |yaw rate| the accelerometer bias is read, rad/s
    uint32_t feedback;    // 1: estimates are subtracted from the platform's input; 0: black box, the platform runs open
};

template <class S>
struct TwoStage : FixedGain<S> {
    using Scalar = S;
    using Params = TwoStageParams<S>;

    using FixedGain<S>::platform;
    using FixedGain<S>::gyro_bias;
    using FixedGain<S>::accel_bias;
    using FixedGain<S>::excitation;

    LEVELHEAD_HOT void step(const Params& k, S dt, const Vec3<S>& gyro, const Vec3<S>& accel) {
        const Vec3<S> none = {S(0), S(0), S(0)};
        const Vec3<S> w = gyro - (k.feedback ? gyro_bias : none);
        const Vec3<S> f = accel - (k.feedback ? accel_bias : none);
        advance(platform, dt, w, f, platform.dcm_body_to_ned.z);
    }

    Interval<S> epoch(const Params& k, const Fix<S>& fix) {
        const Interval<S> i = close_interval(platform, k.platform, fix);
        learn(k, i);
        return i;
    }

    void learn(const Params& k, const Interval<S>& i) {
        const S rate = absolute(i.yaw_rate);
        const S straight = select(rate < k.straight_rate, i.learn, S(0));
        const S turning = select(rate > k.turn_rate, i.learn, S(0));
        const S gyro_step = straight * minimum(S(1), i.length / k.tau_gyro_lowpass);
        const S accel_step = turning * minimum(S(1), i.length / k.tau_accel_lowpass);
        // Running open, u holds the whole bias; with feedback only what is still left of it.
        const S open = k.feedback ? S(0) : S(1);
        const Vec3<S> all = i.control_rate_body - gyro_bias * open;
        // Without a course the vertical component of u is absent, not zero.
        const Vec3<S> rest = all - i.down_body * (dot(i.down_body, all) * (S(1) - i.steered));

        // Eq. (14) as vectors: b_a = g ((u - b_g)/w_z + tau down x u). The gyro bias is taken off the first term only: then
        // the relation is exact in a steady turn also where the platform runs open (put Eq. 11 into Eq. 14 and see).
        const S g = k.platform.gravity;
        const S yaw_rate = select(rate > k.turn_rate, i.yaw_rate, S(1));
        const Vec3<S> level_rest = rest - i.down_body * dot(i.down_body, rest);
        const Vec3<S> u = i.control_rate_body_level;
        const Vec3<S> read = (level_rest * (S(1) / yaw_rate) + cross(i.down_body, u) * k.platform.tau) * g;
        accel_bias = accel_bias + (read - accel_bias * open) * accel_step;
        // Eq. (12).
        gyro_bias = gyro_bias + rest * gyro_step;

        // Each low-pass learns on its own; there is no interval in which both do. The closed form holds in steady turns only.
        const S slow = absolute(slow_yaw_rate(excitation, i.yaw_rate, i.length, k.platform.tau));
        const S steady_step = select(slow > S(0.5) * k.turn_rate, accel_step, S(0));
        excite(excitation, square_root(gyro_step), square_root(steady_step), i.steered * gyro_step);
    }

    uint32_t settled() const {
        uint32_t bits = excitation_status(excitation);
        // The second stage needs the first: without a gyro bias the accelerometer's reading is not one.
        if (!(bits & GYRO_SETTLED)) bits &= ~static_cast<uint32_t>(ACCEL_SETTLED);
        return bits;
    }
};

}  // namespace levelhead

#endif
