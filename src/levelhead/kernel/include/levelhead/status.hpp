// Status bits and event counters: what an estimator says about itself.
#ifndef LEVELHEAD_STATUS_HPP
#define LEVELHEAD_STATUS_HPP

#include <stdint.h>

namespace levelhead {

enum Status : uint32_t {
    INITIALIZING = 1,         // the attitude is not known yet
    ALIGNING = 2,             // roll and pitch are known, the heading is not
    COASTING = 4,             // no GNSS correction at work
    REVERSE = 8,              // driving backwards: the course is turned round
    GYRO_SETTLED = 16,        // the driving so far has taught the horizontal gyro biases
    ACCEL_SETTLED = 32,       // ... the horizontal accelerometer biases
    ACCEL_UNOBSERVABLE = 64,  // hardly any turning: accelerometer bias and tilt cannot be told apart
    UNSEPARATED = 128,        // turning at one constant rate: gyro and accelerometer bias cannot be told apart
    HEADING_SETTLED = 256,    // ... the heading and the vertical gyro bias
    STATIONARY = 512,         // at rest, found by the filter: velocity and angular rate are taken as zero
    COURSE = 1024,            // the course, or an axle that does not slide, has steered the heading in the last interval
};

enum EventCode : uint32_t {
    W_GAP,         // IMU gap bridged, nothing learnt
    E_GAP_RESET,   // IMU gap too long: levelled anew
    S_COAST,       // GNSS absent for longer than an interval can be used
    S_REVERSE,     // epochs driven backwards
    W_TIME_BACK,   // samples or epochs that came out of order
    E_NONFINITE,   // samples or epochs with NaN or infinity
    S_STATIONARY,  // spells at rest, found by the filter
    W_POSITION_JUMP,  // positions were far from the filter's for long: it started anew from them
    EVENT_COUNT,
};

struct EventCounter {
    uint64_t count;
    double first, last;  // time stamps of the first and the last occurrence, s
};

inline void note(EventCounter& event, double time) {
    if (event.count == 0) event.first = time;
    event.last = time;
    event.count += 1;
}

}  // namespace levelhead

#endif
