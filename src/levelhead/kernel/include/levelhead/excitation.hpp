// How much the driving so far has taught. In the averaged loop of the 2015 observer the bias errors e, measured as in its
// V, shrink by e' = -phi phi^T e with phi = (1/sqrt(tau_g), w_z/sqrt(omega_a (1 + (w_z tau)^2))): on a straight line the
// accelerometer's share is zero, on a circle phi never changes direction and one combination of the two biases stays
// for ever. A small control rate proves nothing; what is left of e does.
#ifndef LEVELHEAD_EXCITATION_HPP
#define LEVELHEAD_EXCITATION_HPP

#include "scalar.hpp"
#include "status.hpp"

namespace levelhead {

constexpr double settled_fraction = 0.05;  // known: at most this part of the initial error can be left
constexpr double enough_driving = 3.0;     // about -ln(settled_fraction): three time constants

template <class S>
struct Excitation {
    // The transition from the initial errors (columns: gyro, accel) to those left now (rows), minus the identity, so that
    // all-zero memory means "nothing learnt".
    S gg, ga, ag, aa;
    S gyro, accel;  // sums of phi_gyro^2 and phi_accel^2, capped: how much driving, how much turning
    S slow_rate;    // yaw rate low-passed with tau: what a control rate that lags by tau can follow, rad/s
    S heading;      // what is left of the initial heading and vertical gyro bias, minus 1
};

constexpr double excitation_cap = 1e3;  // a float must still feel an increment

// Weaving quicker than tau teaches nothing, however fast: only the slow part of the yaw rate counts.
template <class S>
S slow_yaw_rate(Excitation<S>& e, S yaw_rate, S length, S tau) {
    e.slow_rate = e.slow_rate + (yaw_rate - e.slow_rate) * minimum(S(1), length / tau);
    return e.slow_rate;
}

// One interval with the shares p = phi_gyro sqrt(T), q = phi_accel sqrt(T), and `steered` = its part of tau_g for the heading.
// Implicit Euler, (I + phi phi^T)^-1, cannot overshoot.
template <class S>
void excite(Excitation<S>& e, S p, S q, S steered) {
    const S k = S(1) / (S(1) + p * p + q * q);
    const S g = (p * (S(1) + e.gg) + q * e.ag) * k, a = (p * e.ga + q * (S(1) + e.aa)) * k;
    e.gg = e.gg - p * g;
    e.ga = e.ga - p * a;
    e.ag = e.ag - q * g;
    e.aa = e.aa - q * a;
    e.gyro = minimum(e.gyro + p * p, S(excitation_cap));
    e.accel = minimum(e.accel + q * q, S(excitation_cap));
    e.heading = (S(1) + e.heading) / (S(1) + steered) - S(1);
}

template <class S>
struct Residual {
    S gyro, accel, heading;  // at most this fraction of the initial errors is left, squared
};

template <class S>
Residual<S> residual_squared(const Excitation<S>& e) {
    const S gg = S(1) + e.gg, aa = S(1) + e.aa, h = S(1) + e.heading;
    return {gg * gg + e.ga * e.ga, aa * aa + e.ag * e.ag, h * h};
}

// For scalar lanes: status bits from what is left.
template <class S>
uint32_t excitation_status(const Excitation<S>& e) {
    constexpr double limit = settled_fraction * settled_fraction;
    const Residual<S> left = residual_squared(e);
    const bool gyro = left.gyro < S(limit), accel = left.accel < S(limit);
    const bool turned = e.accel > S(enough_driving), driven = e.gyro > S(enough_driving);
    return (gyro ? GYRO_SETTLED : 0u) | (accel ? ACCEL_SETTLED : 0u) | (turned ? 0u : ACCEL_UNOBSERVABLE) |
           (driven && turned && !(gyro && accel) ? UNSEPARATED : 0u) |
           (left.heading < S(limit) ? HEADING_SETTLED : 0u);
}

}  // namespace levelhead

#endif
