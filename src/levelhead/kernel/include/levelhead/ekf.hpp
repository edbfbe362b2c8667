// The textbook baseline: an error-state Kalman filter with 15 states (position, velocity, attitude, both biases), strapdown
// and covariance at the IMU's rate, GNSS velocity and course as scalar updates. Here to be compared with, so written as
// textbooks do: dense matrices in plain fixed-size loops; that most of F is zero is not made use of. It has the textbook's
// weakness too: where nothing separates accelerometer bias from tilt (parked, a level straight, a circle) it relinearises at
// estimates that noise moves about, and its sigma shrinks although nothing is learnt.
#ifndef LEVELHEAD_EKF_HPP
#define LEVELHEAD_EKF_HPP

#include "earth.hpp"
#include "platform.hpp"
#include "settled.hpp"

namespace levelhead {

template <class S>
struct EkfParams {
    PlatformParams<S> platform;  // its time constants have no meaning here
    S gyro_noise, accel_noise;   // one-sided densities, rad/s/sqrt(Hz) and m/s^2/sqrt(Hz)
    S gyro_bias_walk, accel_bias_walk;  // rad/s/sqrt(s), m/s^2/sqrt(s)
    S velocity_std;              // where a fix does not tell, m/s
    S initial_gyro_bias_std, initial_accel_bias_std;  // rad/s, m/s^2
    S latitude;                  // rad; NaN: the Earth's rotation is left out
    S position_std, timing_std;  // where a fix does not tell, m; of its stamp: along the way it is off by so much, s
};

// Where each error lies in the state vector; error = estimate - truth, attitude as C_hat = (I + [theta x]) C.
enum EkfState : int { ekf_position = 0, ekf_velocity = 3, ekf_attitude = 6, ekf_gyro_bias = 9, ekf_accel_bias = 12, ekf_states = 15 };

template <class S, int N>
void multiply(const S (&a)[N][N], const S (&b)[N][N], S (&out)[N][N]) {
    for (int i = 0; i < N; ++i) {
        for (int j = 0; j < N; ++j) out[i][j] = S(0);
        for (int k = 0; k < N; ++k)
            for (int j = 0; j < N; ++j) out[i][j] += a[i][k] * b[k][j];
    }
}

// P <- F P F^T, with the mean of the two triangles.
template <class S, int N>
void propagate(S (&p)[N][N], const S (&f)[N][N]) {
    S transposed[N][N], fp[N][N], out[N][N];
    for (int i = 0; i < N; ++i)
        for (int j = 0; j < N; ++j) transposed[j][i] = f[i][j];
    multiply(f, p, fp);
    multiply(fp, transposed, out);
    for (int i = 0; i < N; ++i)
        for (int j = 0; j < N; ++j) p[i][j] = S(0.5) * (out[i][j] + out[j][i]);
}

// Add scale * [a x] to the 3 by 3 block at (row, column).
template <class S, int Rows, int N>
void add_skew(S (&m)[Rows][N], int row, int column, const Vec3<S>& a, S scale) {
    m[row][column + 1] -= a.z * scale;
    m[row][column + 2] += a.y * scale;
    m[row + 1][column] += a.z * scale;
    m[row + 1][column + 2] -= a.x * scale;
    m[row + 2][column] -= a.y * scale;
    m[row + 2][column + 1] += a.x * scale;
}

template <class S>
void set3(S* at, const Vec3<S>& v) {
    at[0] = v.x;
    at[1] = v.y;
    at[2] = v.z;
}

template <class S>
Vec3<S> get3(const S* at) { return {at[0], at[1], at[2]}; }

template <class S>
struct Ekf {
    using Scalar = S;
    using Params = EkfParams<S>;
    static constexpr int n = ekf_states;
    static constexpr bool vertical_accel_bias = true, takes_positions = true, takes_wheels = false;

    PlatformState<S> platform;
    Vec3<S> gyro_bias, accel_bias;
    Geodetic place;    // at the last epoch
    Vec3<S> way;       // made since then, m
    S tracked;         // flag: positions have been seen, the position is more than the way made
    Vec3<S> coriolis;  // see FrameRate
    S elapsed;         // since the last epoch, s
    S turning;         // integral of the squared yaw rate, rad^2/s
    S unseen_rate2;    // variance of the Earth rate that hides in the level gyro biases while the heading is unknown
    S covariance[ekf_states][ekf_states];

    void begin(const Params& k) {
        platform.dcm_body_to_ned = identity<S>();  // so that sigmas can be asked for before the first sample
        for (int i = 0; i < 3; ++i) {
            covariance[ekf_gyro_bias + i][ekf_gyro_bias + i] = k.initial_gyro_bias_std * k.initial_gyro_bias_std;
            covariance[ekf_accel_bias + i][ekf_accel_bias + i] = k.initial_accel_bias_std * k.initial_accel_bias_std;
        }
        forget_motion();
    }

    // The biases keep their covariance.
    void restart(const Params&, const Vec3<S>& specific_force, S) {
        levelhead::restart(platform, specific_force);
        forget_motion();
    }

    void bridged(S gap, const Vec3<S>& gyro_change, const Vec3<S>& accel_change) {
        const HiddenMotion<S> hidden = hidden_motion(gap, gyro_change, accel_change);
        add_diagonal(ekf_attitude, hidden.tilt);
        add_diagonal(ekf_velocity, hidden.velocity);
    }

    bool tick(const Params&) { return false; }

    // A Kalman filter can use any interval; levelling averages over one and cannot.
    double longest(const Params&) const { return platform.aligned > S(0.5) ? 1e9 : max_interval; }

    Vec3<S> velocity(const Params& k, S since_epoch) const {
        const Vec3<S> steady = Vec3<S>{S(0), S(0), k.platform.gravity} - cross(coriolis, platform.velocity_ned);
        return platform.velocity_ned + platform.delta_velocity + steady * since_epoch;
    }

    uint32_t manner() const { return 0u; }

    Geodetic position() const { return moved(place, widened(way)); }  // unknown where the place is

    Sigma<S> sigma() const {
        const Directions d = directions();
        const S unknown = S(NAN);
        const S heading = platform.heading_known > S(0.5) ? spread(ekf_attitude, d.heading_error) : S(pi);
        const auto axis = [this](int i, S more) { return square_root(maximum(covariance[i][i] + more, S(0))); };
        return {{axis(ekf_gyro_bias, unseen_rate2), axis(ekf_gyro_bias + 1, unseen_rate2), axis(ekf_gyro_bias + 2, unseen_rate2)},
                {axis(ekf_accel_bias, S(0)), axis(ekf_accel_bias + 1, S(0)), axis(ekf_accel_bias + 2, S(0))},
                {spread(ekf_attitude, d.roll_error), spread(ekf_attitude, d.pitch_error), heading},
                {axis(ekf_velocity, S(0)), axis(ekf_velocity + 1, S(0)), axis(ekf_velocity + 2, S(0))},
                tracked > S(0.5) ? Vec3<S>{axis(ekf_position, S(0)), axis(ekf_position + 1, S(0)), axis(ekf_position + 2, S(0))}
                                 : Vec3<S>{unknown, unknown, unknown}};
    }

    uint32_t settled() const {
        const Directions d = directions();
        const auto body = [this](const Vec3<S>& ned) { return transposed_times(platform.dcm_body_to_ned, ned); };
        const Vec3<S> forward = body(d.forward), right = body(d.right), down = platform.dcm_body_to_ned.z;
        return settled_bits(maximum(spread(ekf_gyro_bias, forward), spread(ekf_gyro_bias, right)),
                            maximum(spread(ekf_accel_bias, forward), spread(ekf_accel_bias, right)),
                            spread(ekf_gyro_bias, down), sigma().attitude.z, turning > S(enough_turning));
    }

    void step(const Params& k, S dt, const Vec3<S>& gyro, const Vec3<S>& accel) {
        const Dcm<S> before = platform.dcm_body_to_ned;
        const Vec3<S> gained = platform.delta_velocity, v = velocity(k, elapsed);
        advance(platform, dt, gyro - gyro_bias, accel - accel_bias, before.z);
        elapsed = elapsed + dt;
        if (platform.aligned > S(0.5)) {
            way = way + (v + velocity(k, elapsed)) * (S(0.5) * dt);
            const Dcm<S>& after = platform.dcm_body_to_ned;
            const Dcm<S> mean = {(before.x + after.x) * S(0.5), (before.y + after.y) * S(0.5), (before.z + after.z) * S(0.5)};
            predict(k, dt, mean, platform.delta_velocity - gained);
        }
        add_diagonal(ekf_gyro_bias, k.gyro_bias_walk * k.gyro_bias_walk * dt);
        add_diagonal(ekf_accel_bias, k.accel_bias_walk * k.accel_bias_walk * dt);
    }

    Interval<S> epoch(const Params& k, const Fix<S>& reported) {
        Fix<S> fix = reported;
        const auto known = [&k](S std) { return std == std ? std : k.velocity_std; };
        fix.std = {known(fix.std.x), known(fix.std.y), known(fix.std.z)};
        if (!fix.has_velocity) return position_alone(k, fix);
        const S heading_before = heading(platform.dcm_body_to_ned);
        const Sighting<S> e = sight(platform, k.platform, fix);
        Vec3<S> v = e.velocity;
        if (e.aligned_now) {
            begin_covariance(k, e, fix);
        } else if (e.was_aligned) {
            if (!e.at_rest) turning = minimum(turning + platform.turn * platform.turn * e.rate, S(1e3));
            if (e.turned_now) set_heading(e, fix, wrap_angle(heading(platform.dcm_body_to_ned) - heading_before));
            // Accelerations that are seen from an unknown heading teach nothing about the tilt, unless there are none.
            if (e.knew_heading || (e.at_rest && !e.turned_now)) {
                v = velocity(k, fix.length);
                correct_velocity(k, e, fix, v);
                correct_heading(e, fix, v);
            } else {
                reset_velocity(fix.std);
            }
        }
        if (e.was_aligned || e.aligned_now) locate(k, fix, v);
        // Until then "North" is wherever the platform points, exactly; it is no error that velocities at rest could show.
        if (!(platform.heading_known > S(0.5))) clear(ekf_attitude + 2, S(0));
        begin_interval(platform, e, v);
        if (!e.waiting) elapsed = S(0);
        feel_the_earth(k);
        Interval<S> out{};
        out.waiting = e.waiting ? S(1) : S(0);
        return out;
    }

  private:
    // Horizontal axes along and across the heading, and the NED rotation vectors that make up errors of roll, pitch, heading.
    struct Directions {
        Vec3<S> forward, right, roll_error, pitch_error, heading_error;
    };

    Directions directions() const {
        const Dcm<S>& c = platform.dcm_body_to_ned;
        const S angle = heading(c), sin_pitch = -c.z.x;
        const S cos_h = cosine(angle), sin_h = sine(angle);
        // Pointing straight up, roll and heading turn about one axis and neither can be told.
        const S cos_pitch = maximum(square_root(c.z.y * c.z.y + c.z.z * c.z.z), S(1e-3));
        const Vec3<S> forward = {cos_h, sin_h, S(0)}, right = {-sin_h, cos_h, S(0)}, down = {S(0), S(0), S(1)};
        return {forward, right, forward * (S(1) / cos_pitch), right, down + forward * (sin_pitch / cos_pitch)};
    }

    // One sigma of the 3-vector at `at` along a direction.
    S spread(int at, const Vec3<S>& u) const {
        const S a[3] = {u.x, u.y, u.z};
        S sum = S(0);
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) sum += a[i] * covariance[at + i][at + j] * a[j];
        return square_root(maximum(sum, S(0)));
    }

    void add_diagonal(int at, S variance) {
        for (int i = 0; i < 3; ++i) covariance[at + i][at + i] += variance;
    }

    // One state starts anew, independent of all others.
    void clear(int state, S variance) {
        for (int j = 0; j < n; ++j) covariance[state][j] = covariance[j][state] = S(0);
        covariance[state][state] = variance;
    }

    void reset_velocity(const Vec3<S>& std) {
        clear(ekf_velocity, std.x * std.x);
        clear(ekf_velocity + 1, std.y * std.y);
        clear(ekf_velocity + 2, std.z * std.z);
    }

    void forget_motion() {
        way = coriolis = {S(0), S(0), S(0)};
        place = {NAN, NAN, NAN};
        tracked = S(0);
        elapsed = unseen_rate2 = S(0);
        for (int i = 0; i < 3; ++i) {
            clear(ekf_position + i, S(0));
            clear(ekf_velocity + i, S(0));
            clear(ekf_attitude + i, S(pi * pi));
        }
    }

    // theta' = -w_in x theta - C b_g, v' = -f x theta - C b_a - coriolis x v, p' = v, over a step with the mean attitude `c`
    // and the velocity increment `dv`. White noise of one-sided density d: d^2 / 2 per second.
    void predict(const Params& k, S dt, const Dcm<S>& c, const Vec3<S>& dv) {
        S f[ekf_states][ekf_states] = {};
        for (int i = 0; i < n; ++i) f[i][i] = S(1);
        for (int i = 0; i < 3; ++i) f[ekf_position + i][ekf_velocity + i] = dt;
        add_skew(f, ekf_velocity, ekf_velocity, coriolis, -dt);
        add_skew(f, ekf_velocity, ekf_attitude, dv, S(-1));
        add_skew(f, ekf_attitude, ekf_attitude, platform.control_rate_ned, -dt);
        const Vec3<S> rows[3] = {c.x * -dt, c.y * -dt, c.z * -dt};
        for (int i = 0; i < 3; ++i) {
            set3(f[ekf_velocity + i] + ekf_accel_bias, rows[i]);
            set3(f[ekf_attitude + i] + ekf_gyro_bias, rows[i]);
        }
        // First order in the step but for the one term that shows: the tilt that a gyro bias makes within the step moves the velocity too.
        const Vec3<S> half = dv * (S(0.5) * dt);
        set3(f[ekf_velocity] + ekf_gyro_bias, c.z * half.y - c.y * half.z);
        set3(f[ekf_velocity + 1] + ekf_gyro_bias, c.x * half.z - c.z * half.x);
        set3(f[ekf_velocity + 2] + ekf_gyro_bias, c.y * half.x - c.x * half.y);
        propagate(covariance, f);
        add_diagonal(ekf_velocity, S(0.5) * k.accel_noise * k.accel_noise * dt);
        add_diagonal(ekf_attitude, S(0.5) * k.gyro_noise * k.gyro_noise * dt);
    }

    // Levelling ties the tilt to the biases: on average over the interval C f = f_gnss, so that with e, the noise of the
    // latter, g theta_x = (C b_a)_y + e_y and g theta_y = -(C b_a)_x - e_x; and the tilt is that of the interval's middle,
    // half of which the gyro bias has turned it on since.
    void begin_covariance(const Params& k, const Sighting<S>& e, const Fix<S>& fix) {
        const Dcm<S>& c = platform.dcm_body_to_ned;
        const S length = fix.length, per_g = S(1) / k.platform.gravity;
        S m[ekf_states][ekf_states] = {};
        for (int i = ekf_gyro_bias; i < n; ++i) m[i][i] = S(1);
        set3(m[ekf_attitude] + ekf_accel_bias, c.y * per_g);
        set3(m[ekf_attitude + 1] + ekf_accel_bias, c.x * -per_g);
        set3(m[ekf_attitude] + ekf_gyro_bias, c.x * (S(-0.5) * length));
        set3(m[ekf_attitude + 1] + ekf_gyro_bias, c.y * (S(-0.5) * length));
        propagate(covariance, m);
        reset_velocity(fix.std);

        const S var[2] = {fix.std.x * fix.std.x, fix.std.y * fix.std.y};
        const S white = S(0.5) * k.accel_noise * k.accel_noise * e.rate;
        const S drift = S(0.5) * k.gyro_noise * k.gyro_noise * length;
        // With an unknown heading nobody knows which way the measured acceleration points.
        const Vec3<S>& a = e.gnss_force;
        const S astray = e.trusted ? S(0) : S(2) * (a.x * a.x + a.y * a.y);
        for (int i = 0; i < 2; ++i) {
            const int tilt = ekf_attitude + i, speed = ekf_velocity + 1 - i;
            const S v = var[1 - i];
            covariance[tilt][tilt] += (S(2) * v * e.rate * e.rate + white + astray) * per_g * per_g + drift;
            covariance[tilt][speed] = covariance[speed][tilt] = (i == 0 ? v : -v) * e.rate * per_g;
        }
        clear(ekf_attitude + 2, course_variance(e, fix));
    }

    static S course_variance(const Sighting<S>& e, const Fix<S>& fix) {
        const S std = horizontal_std(fix.std);
        return std * std / maximum(e.speed2, S(1e-6));
    }

    // The first course has turned the platform, and the tilt errors with it.
    void set_heading(const Sighting<S>& e, const Fix<S>& fix, S turned) {
        S m[ekf_states][ekf_states] = {};
        for (int i = 0; i < n; ++i) m[i][i] = S(1);
        m[ekf_attitude][ekf_attitude] = m[ekf_attitude + 1][ekf_attitude + 1] = cosine(turned);
        m[ekf_attitude][ekf_attitude + 1] = -sine(turned);
        m[ekf_attitude + 1][ekf_attitude] = sine(turned);
        propagate(covariance, m);
        clear(ekf_attitude + 2, course_variance(e, fix));
        add_diagonal(ekf_gyro_bias, unseen_rate2);
    }

    // One scalar measurement z = h . error + noise of this variance, in Joseph's form; `error` gathers the corrections.
    void update(const S (&h)[ekf_states], S z, S variance, S (&error)[ekf_states]) {
        S ph[ekf_states], gain[ekf_states], rest[ekf_states];
        S total = variance, surprise = z;
        for (int i = 0; i < n; ++i) {
            ph[i] = S(0);
            for (int j = 0; j < n; ++j) ph[i] += covariance[i][j] * h[j];
            total += h[i] * ph[i];
            surprise -= h[i] * error[i];
        }
        if (!(total > S(0) && total * S(0) == S(0))) return;  // an infinite sigma says nothing
        for (int i = 0; i < n; ++i) gain[i] = ph[i] / total;
        for (int i = 0; i < n; ++i) error[i] += gain[i] * surprise;
        // (I - K h) P (I - K h)^T + K R K^T, first from the left, then from the right.
        for (int i = 0; i < n; ++i) {
            rest[i] = S(0);
            for (int j = 0; j < n; ++j) covariance[i][j] -= gain[i] * ph[j];
            for (int j = 0; j < n; ++j) rest[i] += covariance[i][j] * h[j];
        }
        for (int i = 0; i < n; ++i)
            for (int j = 0; j < n; ++j) covariance[i][j] += (variance * gain[i] - rest[i]) * gain[j];
        for (int i = 0; i < n; ++i)
            for (int j = 0; j < i; ++j) covariance[i][j] = covariance[j][i] = S(0.5) * (covariance[i][j] + covariance[j][i]);
    }

    // Take the estimated errors out.
    void feed_back(const S (&error)[ekf_states], Vec3<S>& v) {
        way = way - get3(error + ekf_position);
        v = v - get3(error + ekf_velocity);
        platform.dcm_body_to_ned = rotated_in_ned(platform.dcm_body_to_ned, get3(error + ekf_attitude) * S(-1));
        gyro_bias = gyro_bias - get3(error + ekf_gyro_bias);
        accel_bias = accel_bias - get3(error + ekf_accel_bias);
    }

    // Three velocity scalars in sequence, taken at the antenna: v + C (w x l).
    void correct_velocity(const Params& k, const Sighting<S>& e, const Fix<S>& fix, Vec3<S>& v) {
        const Dcm<S>& c = platform.dcm_body_to_ned;
        const Vec3<S>& arm = k.platform.lever_arm;
        const Vec3<S> swing = c * cross(platform.angular_rate, arm);
        S h[3][ekf_states] = {}, error[ekf_states] = {}, z[3], std[3];
        set3(z, v - e.velocity);
        set3(std, fix.std);
        if (!e.knew_heading) {
            // At rest, or creeping off: what is more than noise has a direction that nobody knows, in both velocities.
            const S noise = horizontal_std(fix.std), astray = S(2) * maximum(e.speed2 - S(4) * noise * noise, S(0));
            for (int i = 0; i < 2; ++i) std[i] = square_root(std[i] * std[i] + astray);
        }
        add_skew(h, 0, ekf_attitude, swing, S(-1));
        set3(h[0] + ekf_gyro_bias, cross(c.x, arm));
        set3(h[1] + ekf_gyro_bias, cross(c.y, arm));
        set3(h[2] + ekf_gyro_bias, cross(c.z, arm));
        for (int i = 0; i < 3; ++i) {
            h[i][ekf_velocity + i] = S(1);
            update(h[i], z[i], std[i] * std[i], error);
        }
        feed_back(error, v);
    }

    // A position of the antenna, p + C l: at first, and before the heading is known, it is taken; then it is measured, along
    // the way, across it and down.
    void locate(const Params& k, const Fix<S>& fix, Vec3<S>& v) {
        const Vec3<S> arm = platform.dcm_body_to_ned * k.platform.lever_arm;
        if (fix.has_position) {
            const auto known = [&k](S std) { return std == std ? std : k.position_std; };
            const S std[3] = {known(fix.position_std.x), known(fix.position_std.y), known(fix.position_std.z)};
            if (tracked > S(0.5) && platform.heading_known > S(0.5)) {
                correct_position(k, fix, arm, std, v);
            } else {
                place = moved(fix.position, widened(arm * S(-1)));
                way = {S(0), S(0), S(0)};
                tracked = S(1);
                for (int i = 0; i < 3; ++i) clear(ekf_position + i, std[i] * std[i]);
            }
        }
        if (tracked > S(0.5)) place = moved(place, widened(way));
        way = {S(0), S(0), S(0)};
    }

    void correct_position(const Params& k, const Fix<S>& fix, const Vec3<S>& arm, const S (&std)[3], Vec3<S>& v) {
        const Vec3<S> off = narrowed<S>(offset_ned(fix.position, moved(place, widened(way)))) + arm;
        const S speed = square_root(v.x * v.x + v.y * v.y), level = square_root(S(0.5) * (std[0] * std[0] + std[1] * std[1]));
        const S north = speed > S(0.1) ? v.x / speed : S(1), east = speed > S(0.1) ? v.y / speed : S(0), late = k.timing_std;
        const Vec3<S> ways[3] = {{north, east, S(0)}, {-east, north, S(0)}, {S(0), S(0), S(1)}};
        const S variance[3] = {level * level + late * late * speed * speed, level * level, std[2] * std[2] + late * late * v.z * v.z};
        S lever[3][ekf_states] = {}, error[ekf_states] = {};
        add_skew(lever, 0, ekf_attitude, arm, S(-1));
        for (int i = 0; i < 3; ++i) {
            S h[ekf_states] = {};
            set3(h + ekf_position, ways[i]);
            for (int j = 0; j < 3; ++j)
                h[ekf_attitude + j] = ways[i].x * lever[0][ekf_attitude + j] + ways[i].y * lever[1][ekf_attitude + j] +
                                      ways[i].z * lever[2][ekf_attitude + j];
            update(h, dot(ways[i], off), variance[i], error);
        }
        feed_back(error, v);
    }

    // Start-up needs velocities; after it a position serves by itself.
    Interval<S> position_alone(const Params& k, const Fix<S>& fix) {
        Interval<S> out{};
        if (!(platform.heading_known > S(0.5))) {
            out.waiting = S(1);  // the interval that start-up levels over goes on
            return out;
        }
        const S rate = S(1) / maximum(elapsed, S(1e-6));
        turning = minimum(turning + platform.turn * platform.turn * rate, S(1e3));
        Vec3<S> v = velocity(k, elapsed);
        locate(k, fix, v);
        Sighting<S> e{};
        begin_interval(platform, e, v);
        elapsed = S(0);
        feel_the_earth(k);
        return out;
    }

    // The course is the heading, or the opposite in reverse.
    void correct_heading(const Sighting<S>& e, const Fix<S>& fix, Vec3<S>& v) {
        const bool steered = e.trusted && e.knew_heading;
        const S ahead = course_innovation(platform, steered, e.course);
        if (!steered) return;
        S h[ekf_states] = {}, error[ekf_states] = {};
        set3(h + ekf_attitude, directions().heading_error);
        update(h, -ahead, course_variance(e, fix), error);
        feed_back(error, v);
    }

    // The frame that the platform is level in turns with the Earth and with the way made good on it.
    void feel_the_earth(const Params& k) {
        const FrameRate<S> rate = frame_rate(k.latitude, platform.velocity_ned);
        platform.control_rate_ned = rate.turn;
        platform.hold = S(1e30);  // until the next epoch, whenever that is
        coriolis = rate.coriolis;
        unseen_rate2 = S(0);
        if (!(platform.heading_known > S(0.5))) {
            // Without North only the vertical part is known; the rest looks like a gyro bias.
            unseen_rate2 = S(0.5) * (rate.turn.x * rate.turn.x + rate.turn.y * rate.turn.y);
            platform.control_rate_ned = {S(0), S(0), rate.turn.z};
            coriolis = {S(0), S(0), S(0)};
        }
    }
};

}  // namespace levelhead

#endif
