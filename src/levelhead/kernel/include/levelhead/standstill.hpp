// Is the vehicle at rest? A second of readings at a time: by the GNSS velocities in it where there are any, else by how the
// sensors' unrest compares with what it was at rest and in motion before. An engine's vibration is part of both.
#ifndef LEVELHEAD_STANDSTILL_HPP
#define LEVELHEAD_STANDSTILL_HPP

#include "vec3.hpp"

namespace levelhead {

constexpr double rest_window = 0.999;   // s
constexpr double rest_speed = 0.02;     // a mean velocity within its noise and this is none, m/s
constexpr double rest_doubt = 0.1;    // a mean velocity known to three sigmas of this alone decides, m/s
constexpr double rest_peak = 0.15;      // no single one may be faster than this and its noise, m/s
constexpr double rest_rate = 3e-3;      // mean angular rate: a tenth of the slowest headland turn, rad/s
constexpr double rest_distance = 4.0;   // unrest in motion over unrest at rest (both squared) that tells them apart
constexpr double rest_memory = 0.1;     // how fast these two follow, per second
constexpr double rest_near = 2.0;           // faster than this the vehicle cannot stand within a second, m/s:
constexpr double rest_pause = 7.0;          // then one second in eight shows the sensors' unrest in motion, s
constexpr double rest_velocity_std = 0.02;  // what "at rest" says of the velocity, m/s

// Mean and mean square of one kind of reading over the window, and what the latter was at rest and in motion.
template <class S>
struct Unrest {
    Vec3<S> sum;
    S square, quiet, busy;

    LEVELHEAD_HOT void add(const Vec3<S>& x, S dt) {
        sum = sum + x * dt;
        square = square + dot(x, x) * dt;
    }

    S now(S time) const { return maximum(square / time - dot(sum, sum) / (time * time), S(0)); }
    bool tells() const { return quiet > S(0) && busy > S(rest_distance) * quiet; }
    bool still(S time) const {
        const S v = now(time);
        return v * v < quiet * busy;
    }
    void learn(S time, bool rest) {
        S& known = rest ? quiet : busy;
        const S v = now(time);
        known = known > S(0) ? known + (v - known) * S(rest_memory) : v;
    }
    void clear() {
        sum = {S(0), S(0), S(0)};
        square = S(0);
    }
};

template <class S>
struct Standstill {
    Unrest<S> rate, force;
    S time;
    Vec3<S> velocity;       // sum over the fixes
    S fixes, fastest2, variance;  // how many, the largest squared speed, the sum of their variances per axis
    S still;                // 1: the last window was at rest
    S paused, pause;        // 1: nothing is looked at; for how long, s

    // The gyros' own readings: the bias that is known of them may change within the window.
    LEVELHEAD_HOT void add(const Vec3<S>& gyro, const Vec3<S>& f, S dt) {
        rate.add(gyro, dt);
        force.add(f, dt);
        time = time + dt;
    }

    void see(const Vec3<S>& v, S std) {
        velocity = velocity + v;
        fixes = fixes + S(1);
        variance = variance + std * std;
        fastest2 = maximum(fastest2, v.x * v.x + v.y * v.y);
    }

    // The mean reading of the gyros over the window.
    Vec3<S> mean_rate() const { return rate.sum * (S(1) / time); }

    // Decide at the end of a window. `bias` is the gyros' and `slack` how wrong it can be, `speed2` and `speed_var` are the
    // filter's own.
    void judge(const Vec3<S>& bias, S slack, S speed2, S speed_var) {
        const bool turning = norm(mean_rate() - bias) > S(rest_rate) + S(3) * slack;
        const bool quiet = (!rate.tells() || rate.still(time)) && (!force.tells() || force.still(time)) && (rate.tells() || force.tells());
        if (fixes > S(0)) {
            const S n = S(1) / fixes, std2 = variance * n, peak = S(rest_peak) + S(3) * square_root(std2);
            const S mean2 = (velocity.x * velocity.x + velocity.y * velocity.y) * n * n;
            const bool slow = mean2 < S(rest_speed * rest_speed) + S(9) * std2 * n && fastest2 < peak * peak;
            const bool sure = S(9) * std2 * n < S(rest_doubt * rest_doubt);
            still = slow && !turning && (sure || quiet) ? S(1) : S(0);
            // In between, creeping, teaches neither.
            if (still > S(0.5) || fastest2 > S(1)) {
                rate.learn(time, still > S(0.5));
                force.learn(time, still > S(0.5));
            }
            return;
        }
        const bool slow = speed2 < S(0.1) + S(18) * speed_var;
        still = slow && quiet && !turning ? S(1) : S(0);
    }

    // The window is over; the next one begins at once, or later where the vehicle is fast.
    void next(S speed2) {
        clear();
        paused = still < S(0.5) && speed2 > S(rest_near * rest_near) ? S(1) : S(0);
        pause = S(0);
    }

    // While nothing is looked at.
    void wait(S speed2, S time) {
        pause = pause + time;
        if (paused > S(0.5) && (speed2 < S(rest_near * rest_near) || pause > S(rest_pause))) {
            clear();
            paused = S(0);
        }
    }

    void clear() {
        rate.clear();
        force.clear();
        time = fixes = fastest2 = variance = S(0);
        velocity = {S(0), S(0), S(0)};
    }
};

}  // namespace levelhead

#endif
