// levelhead: gyro and accelerometer biases of a land vehicle from IMU and GNSS velocity. Header-only C++17 without STL,
// heap, exceptions or RTTI. Frames: body x forward, y right, z down; navigation North, East, Down. SI units and radians.
// reading = truth + bias.
#ifndef LEVELHEAD_LEVELHEAD_HPP
#define LEVELHEAD_LEVELHEAD_HPP

#include "covariance.hpp"
#include "ekf.hpp"
#include "mahony.hpp"
#include "observer.hpp"
#include "phasor.hpp"
#include "retrace.hpp"
#include "smoother.hpp"
#include "stream.hpp"
#include "two_stage.hpp"

#endif
