// The explicit complementary filter with gyro bias of Mahony, Hamel and Pflimlin (2008), Eqs. (32), here as a baseline: the
// vertical that the accelerometers show at every sample pulls the attitude home and the gyro biases along.
//
//     C' = C [(gyro - b + w_m / tau) x],   b' = -w_m / (tau tau_gyro),   w_m = v x (C^T down)
//
// where v is the measured down direction and w_m (rad) is what is wrong with the tilt. Per axis the tilt error e obeys
// e'' + e'/tau + e/(tau tau_gyro) = 0, the papers' tau s^2 + s + 1/tau_gyro: kP = 1/tau and kI = 1/(tau tau_gyro) as time
// constants that compare with those of the 2015 observer. Accelerations of the vehicle are no gravity: v comes from
// C^T a_gnss - accel, or from -accel alone to show what that does. There is no accelerometer bias: it stays in the tilt.
#ifndef LEVELHEAD_MAHONY_HPP
#define LEVELHEAD_MAHONY_HPP

#include "fixed_gain.hpp"
#include "settled.hpp"

namespace levelhead {

template <class S>
struct MahonyParams {
    PlatformParams<S> platform;
    S tau_gyro;  // s
    uint32_t use_gnss_acceleration;  // 1: GNSS acceleration is taken out of the specific force; 0: it is not
};

template <class S>
struct Mahony : FixedGain<S> {
    using Scalar = S;
    using Params = MahonyParams<S>;

    using FixedGain<S>::platform;
    using FixedGain<S>::gyro_bias;
    using FixedGain<S>::accel_bias;
    using FixedGain<S>::excitation;

    Vec3<S> acceleration;  // of the last GNSS interval, held over the next, NED, m/s^2
    S hold;                // how long it has still to act, s
    S turning;             // integral of the squared yaw rate, rad^2/s
    S blind;               // how much of an IMU gap lies ahead: nothing is learnt in it, s

    void restart(const Params&, const Vec3<S>& specific_force, S) {
        levelhead::restart(platform, specific_force);
        acceleration = {S(0), S(0), S(0)};
        hold = blind = S(0);
    }

    void bridged(S gap, const Vec3<S>&, const Vec3<S>&) { blind = gap; }

    void step(const Params& k, S dt, const Vec3<S>& gyro, const Vec3<S>& accel) {
        const Vec3<S> f = accel - accel_bias;
        const bool seeing = blind < S(0.5) * dt;
        const bool known = k.use_gnss_acceleration ? hold > S(0) : platform.aligned > S(0.5);
        Vec3<S> w = gyro - gyro_bias;
        if (seeing && known) {
            const Dcm<S>& c = platform.dcm_body_to_ned;
            Vec3<S> down = f * S(-1);
            if (k.use_gnss_acceleration) down = transposed_times(c, acceleration) - f;
            const Vec3<S> wrong = cross(down, c.z) * (S(1) / maximum(norm(down), S(1e-3)));
            // A correction never exceeds what was measured, however long the step.
            const S gain = minimum(S(1) / k.platform.tau, S(1) / dt);
            w = w + wrong * gain;
            gyro_bias = gyro_bias - wrong * (gain * dt / k.tau_gyro);
        }
        blind = maximum(blind - dt, S(0));
        hold = maximum(hold - dt, S(0));
        advance(platform, dt, w, f, platform.dcm_body_to_ned.z);
    }

    Interval<S> epoch(const Params& k, const Fix<S>& fix) {
        const Sighting<S> e = sight(platform, k.platform, fix);
        const bool steered = e.closed && e.was_aligned && e.knew_heading && e.trusted;
        const S innovation = course_innovation(platform, steered, e.course);
        const S turn = steered ? -innovation * minimum(S(1) / k.platform.tau_heading, e.rate) : S(0);
        platform.control_rate_ned = {S(0), S(0), turn};
        platform.hold = fix.length;
        gyro_bias = gyro_bias + platform.dcm_body_to_ned.z * (turn * fix.length / k.tau_gyro);

        // Which way it points can be told from a known heading only, unless there is none.
        const bool aligned = platform.aligned > S(0.5), oriented = platform.heading_known > S(0.5) || e.at_rest;
        acceleration = e.gnss_force + Vec3<S>{S(0), S(0), k.platform.gravity};
        hold = e.closed && aligned && oriented ? fix.length : S(0);
        if (e.was_aligned) turning = minimum(turning + platform.turn * platform.turn * e.rate, S(excitation_cap));
        if (aligned && (hold > S(0) || !k.use_gnss_acceleration))
            excite(excitation, square_root(fix.length / k.tau_gyro), S(0), steered ? fix.length / k.tau_gyro : S(0));
        begin_interval(platform, e, e.velocity);
        Interval<S> out{};
        out.waiting = e.waiting ? S(1) : S(0);
        return out;
    }

    // The tilt that an accelerometer bias b leaves turns with the vehicle, and at the rate w the gyro biases are pulled by
    // w b / g: whoever has turned and does not know b does not know them either.
    uint32_t settled() const {
        const uint32_t bits = excitation_status(excitation);
        return turning > S(enough_turning) ? (bits & HEADING_SETTLED) | UNSEPARATED : bits;
    }
};

}  // namespace levelhead

#endif
