// What the papers' fixed-gain estimators have in common: the virtual platform, two biases, what the driving has taught.
#ifndef LEVELHEAD_FIXED_GAIN_HPP
#define LEVELHEAD_FIXED_GAIN_HPP

#include "excitation.hpp"
#include "platform.hpp"

namespace levelhead {

// The hooks of `Stream` that need nothing special here; a gain that is fixed carries no covariance.
template <class S>
struct FixedGain {
    PlatformState<S> platform;
    Vec3<S> gyro_bias, accel_bias;
    Excitation<S> excitation;

    static constexpr bool takes_positions = false, takes_wheels = false;
    static constexpr bool vertical_accel_bias = false;  // level driving teaches nothing about the vertical one

    template <class Params>
    void begin(const Params&) {}

    template <class Params>
    void restart(const Params&, const Vec3<S>& specific_force, S) {
        levelhead::restart(platform, specific_force);
    }

    void bridged(S, const Vec3<S>&, const Vec3<S>&) {}

    template <class Params>
    bool tick(const Params&) { return false; }

    // An interval much longer than tau says little about the attitude at its end, and the loop turns unstable.
    template <class Params>
    static double longest(const Params& k) {
        const double two_tau = 2.0 * double(k.platform.tau);
        return two_tau < max_interval ? two_tau : max_interval;
    }

    template <class Params>
    Vec3<S> velocity(const Params& k, S since_epoch) const {
        return current_velocity(platform, k.platform.gravity, since_epoch);
    }

    // Status bits of how the vehicle is found to move.
    uint32_t manner() const { return 0u; }

    Sigma<S> sigma() const {
        const S unknown = S(NAN);
        const Vec3<S> v = {unknown, unknown, unknown};
        return {v, v, v, v, v};
    }
};

}  // namespace levelhead

#endif
