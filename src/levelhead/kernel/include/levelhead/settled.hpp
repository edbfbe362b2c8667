// When a filter with a covariance calls something known: the same limits for every such filter.
#ifndef LEVELHEAD_SETTLED_HPP
#define LEVELHEAD_SETTLED_HPP

#include "scalar.hpp"
#include "status.hpp"

namespace levelhead {

constexpr double settled_gyro_std = 0.01 * pi / 180.0;  // rad/s
constexpr double settled_accel_std = 0.02;              // m/s^2
constexpr double settled_heading_std = pi / 180.0;      // rad
// The squared yaw rate summed over time that counts as turning: a headland turn, a quarter of a minute of a circle, rad^2/s.
constexpr double enough_turning = 0.5;

// Sigmas of the two level gyro axes (the larger), the two level accelerometer axes, the vertical gyro, and the heading.
template <class S>
uint32_t settled_bits(S sigma_gyro, S sigma_accel, S sigma_gyro_z, S sigma_heading, bool turned) {
    const bool gyro = sigma_gyro < S(settled_gyro_std);
    // Without a turn nothing but rolling ground, which leans them into the vertical, tells the accelerometer biases (to a filter
    // with full covariance): a second-order effect, and not enough to call them known.
    const bool accel = turned && sigma_accel < S(settled_accel_std);
    const bool heading = sigma_gyro_z < S(settled_gyro_std) && sigma_heading < S(settled_heading_std);
    return (gyro ? GYRO_SETTLED : 0u) | (accel ? ACCEL_SETTLED : 0u) | (heading ? HEADING_SETTLED : 0u) |
           (turned ? 0u : ACCEL_UNOBSERVABLE) | (turned && !(gyro && accel) ? UNSEPARATED : 0u);
}

}  // namespace levelhead

#endif
